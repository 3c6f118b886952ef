# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A browser without a window, driven by the DevTools protocol: what a person would do and see."""

import asyncio
import contextlib
import json
import os
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest
from tornado.websocket import websocket_connect

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome-stable', 'google-chrome', 'chrome')
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--disable-dev-shm-usage',
)
AXE = Path(__file__).parent / 'axe_core' / 'axe.min.js'
PATIENCE = 60.0
# what can be used and is shown
CONTROLS = """[...document.querySelectorAll('button, input, a[href], summary, [tabindex="0"]')]
  .filter((one) => !one.disabled && one.checkVisibility())"""


def browser_program():
    """The program that RPMS_BROWSER names, or one of the usual names; skips without one."""
    names = [os.environ['RPMS_BROWSER']] if os.environ.get('RPMS_BROWSER') else BROWSERS
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f'RPMS_BROWSER: no browser of {", ".join(names)} on this machine')
    return found


def _until(found, complaint, timeout=PATIENCE):
    """Return what a call returns as soon as it is something."""
    end = time.monotonic() + timeout
    while not (answer := found()):
        if time.monotonic() > end:
            pytest.fail(f'{complaint} after {timeout} s')
        time.sleep(0.02)
    return answer


async def _connected(url):
    return await websocket_connect(url, max_message_size=2**26)


class Browser:
    """A browser with one page; use it in a ``with`` block."""

    def __init__(self, folder: Path):
        self._folder = folder
        # before anything is opened that a skipped test would leave open
        self._program = browser_program()
        self._loop = asyncio.new_event_loop()
        self._count = 0
        self.events = []

    def __enter__(self):
        own = ('--remote-debugging-port=0', f'--user-data-dir={self._folder}')
        command = [self._program, *FLAGS, *own, 'about:blank']
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            self._socket = self._loop.run_until_complete(_connected(self._address_of_page()))
            for domain in ('Page', 'Runtime', 'Log', 'Network'):
                self.call(f'{domain}.enable')
        except BaseException:
            self._process.kill()
            self._process.wait()
            raise
        return self

    def __exit__(self, *_):
        with contextlib.suppress(Exception):
            self.call('Browser.close')
        self._loop.run_until_complete(self._hang_up())
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._loop.close()

    def call(self, method, **parameters):
        """Ask the browser for something and return its answer."""
        self._count += 1
        request = {'id': self._count, 'method': method, 'params': parameters}
        return self._loop.run_until_complete(asyncio.wait_for(self._answer(request), PATIENCE))

    def evaluate(self, expression):
        """Return the value of an expression in the page, of a promise what it becomes."""
        answer = self.call(
            'Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def text(self, selector):
        """Return the text of an element."""
        return self.evaluate(f'document.querySelector({json.dumps(selector)}).textContent')

    def open(self, url):
        """Open a page."""
        self.events.clear()
        self.call('Page.navigate', url=url)
        # a fragment alone would not load the page again
        self.wait_for('document.readyState === "complete"')

    def wait_for(self, expression, timeout=PATIENCE):
        """Wait until an expression in the page is true."""
        _until(lambda: self.evaluate(expression), f'still waiting for {expression}', timeout)

    def screen(self, width, height=800, dark=False, reduced=False):
        """Show the page on a screen of this width [px], light or dark."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        features = [
            {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'},
            {'name': 'prefers-reduced-motion', 'value': 'reduce' if reduced else 'no-preference'},
        ]
        self.call('Emulation.setEmulatedMedia', features=features)

    def press(self, key):
        """Press and release a key."""
        code = {'Tab': 9, 'Enter': 13, ' ': 32}[key]
        text = {'Enter': '\r', ' ': ' '}.get(key, '')
        for kind in ('keyDown', 'keyUp'):
            self.call(
                'Input.dispatchKeyEvent',
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=code,
                text=text if kind == 'keyDown' else '',
            )

    def to_the_top(self):
        """Have the Tab key begin anew; a blur would leave it where it was."""
        self.evaluate(
            'scrollTo(0, 0); document.body.tabIndex = -1; document.body.focus();'
            'document.body.removeAttribute("tabindex")'
        )

    def beyond_the_keyboard(self):
        """Return the controls that the Tab key does not reach, or where its place is not seen."""
        self.to_the_top()
        count = self.evaluate(
            f'window.controls = {CONTROLS}; controls.forEach((one) => {{ one.reached = false; }});'
            'controls.length'
        )
        for _ in range(count + 1):
            self.press('Tab')
            self.evaluate(
                """(() => {
  const one = document.activeElement, style = getComputedStyle(one);
  // where the browser scrolls to by and by
  one.scrollIntoView({ block: 'nearest', behavior: 'instant' });
  // of a link over two lines the first
  const place = one.getClientRects()[0];
  const middle = (from, to, end) => (Math.max(from, 0) + Math.min(to, end)) / 2;
  one.reached ||= style.outlineStyle !== 'none' && one.contains(document.elementFromPoint(
    middle(place.left, place.right, innerWidth), middle(place.top, place.bottom, innerHeight)));
})()"""
            )
        return self.evaluate(
            'controls.filter((one) => !one.reached).map((one) => one.outerHTML.slice(0, 200))'
        )

    def accessibility_faults(self):
        """Return what axe-core finds wrong with the page as it is now: rule and first element.

        All rules of axe-core count, those of WCAG 2.2 A and AA and what it calls best practice.
        What it cannot decide by itself, such as contrast on a picture, is not a finding.
        """
        if not self.evaluate('typeof axe !== "undefined"'):
            self.evaluate(AXE.read_text(encoding='utf-8') + ';1')
        found = self.evaluate('axe.run(document).then((found) => found.violations)')
        return [(one['id'], one['help'], one['nodes'][0]['html'][:200]) for one in found]

    def complaints(self):
        """Return what the page has complained of: exceptions, errors, warnings of the console."""
        self.call('Runtime.evaluate', expression='0')
        logged = [('Runtime.consoleAPICalled', kind) for kind in ('error', 'warning', 'assert')]
        return [
            event
            for event in self.events
            if event['method'] in ('Runtime.exceptionThrown', 'Log.entryAdded')
            or (event['method'], event['params'].get('type')) in logged
        ]

    def requested(self):
        """Return every address that the page has asked for."""
        asked = [
            event['params']['request']['url']
            for event in self.events
            if event['method'] == 'Network.requestWillBeSent'
        ]
        return asked + [
            event['params']['url']
            for event in self.events
            if event['method'] == 'Network.webSocketCreated'
        ]

    async def _hang_up(self):
        self._socket.close()

    async def _answer(self, request):
        await self._socket.write_message(json.dumps(request))
        while True:
            text = await self._socket.read_message()
            assert text is not None, 'the browser has ended'
            message = json.loads(text)
            if message.get('id') == request['id']:
                assert 'error' not in message, message['error']
                return message['result']
            if 'method' in message:
                self.events.append(message)

    def _address_of_page(self):
        """Return where the page is driven; it may be opened a moment after the port is."""
        address = f'http://127.0.0.1:{_until(self._port, "the browser says no port")}/json/list'

        def pages():
            with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
                return [one for one in json.load(answer) if one['type'] == 'page']

        (page,) = _until(pages, 'the browser opens no page')
        return page['webSocketDebuggerUrl']

    def _port(self):
        assert self._process.poll() is None, 'the browser did not start'
        path = self._folder / 'DevToolsActivePort'
        lines = path.read_text().splitlines() if path.exists() else []
        return int(lines[0]) if len(lines) >= 2 else None
