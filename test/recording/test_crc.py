# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksums are the same whether isal is installed or not."""

import zlib

from hypothesis import given, strategies as st
from isal import isal_zlib

from rpms_ros.recording.rosbag import compression


@given(st.binary(max_size=5000), st.integers(0, 2**32 - 1))
def test_every_function_gives_the_value_of_zlib(data: bytes, before: int) -> None:
    assert compression.crc32(data, before) == zlib.crc32(data, before)
    assert compression.crc32(memoryview(data)) == zlib.crc32(data)


def test_isal_is_taken_and_zlib_where_it_is_missing(monkeypatch) -> None:
    assert compression._quickest() is isal_zlib.crc32

    def missing(name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}')

    monkeypatch.setattr(compression, 'import_module', missing)
    assert compression._quickest() is zlib.crc32
