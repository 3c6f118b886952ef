# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""pytest plugin: a test that did not run must not look like one that passed.

Tests of the recordings may be skipped where the folder of recordings is missing, tests of the
report's page where there is no browser; they say so by naming RPMS_RECORDINGS or RPMS_BROWSER in
the reason.  Any other skip fails the run, and with RPMS_STRICT_SKIPS=1 those too.
"""

import os
from collections.abc import Iterator

import pytest

ALLOWED_REASONS = ('RPMS_RECORDINGS', 'RPMS_BROWSER')


def allowed(reason: str) -> bool:
    """Tell whether a test may be skipped for this reason."""
    strict = os.environ.get('RPMS_STRICT_SKIPS', '') not in ('', '0')
    return not strict and any(name in reason for name in ALLOWED_REASONS)


class SkipPolicy:
    """Collects the skips that are not allowed and fails the session for them."""

    def __init__(self) -> None:
        self.unexpected: list[str] = []

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if not report.skipped or hasattr(report, 'wasxfail'):
            return
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
        if not allowed(reason):
            self.unexpected.append(f'{report.nodeid}: {reason}')

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Look at one test."""
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Look at one module."""
        self._note(report)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Turn success into failure."""
        if self.unexpected and session.exitstatus in (
            pytest.ExitCode.OK,
            pytest.ExitCode.NO_TESTS_COLLECTED,
        ):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @pytest.hookimpl(wrapper=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
        """List them."""
        yield
        if self.unexpected:
            terminalreporter.section('unexpected skips: the run fails', red=True)
        for line in self.unexpected:
            terminalreporter.line(line)


def pytest_configure(config: pytest.Config) -> None:
    """Register the policy in the process that reports."""
    config.pluginmanager.register(SkipPolicy(), 'skip-policy')
