# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile texts: what a stranger, a broken editor or an attacker may send in place of a schedule.

`hostile_text(random)` makes one; `KNOWN` are those that broke something once, or break other
parsers.  `sendable` says whether a ROS message can carry a text at all.
"""

import re
from collections.abc import Callable
from random import Random

SCHEDULE = """\
name: warm-up
seed: 1
width_s: 1.0e-4
segments:
  - {kind: sinusoid, rate_hz: 20.0, duration_s: 18.0, high: 0.6}
  - {kind: pause, duration_s: 5.0}
  - kind: repeat
    times: 3
    segments:
      - {kind: constant, rate_hz: 5.0, final_rate_hz: 20.0, duration_s: 4.0, intensity: 0.4}
      - {kind: doublet, intensity: 0.5, interval_s: 0.01}
  - {kind: staircase, rate_hz: 10.0, duration_s: 2.0, levels: [0.1, 0.2]}
  - {kind: uniform_random, rate_hz: 10.0, duration_s: 2.0, high: 0.5, seed: 4}
"""
WORDS = (
    'name', 'seed', 'width_s', 'segments', 'kind', 'rate_hz', 'final_rate_hz', 'duration_s',
    'intensity', 'low', 'high', 'period_s', 'levels', 'count', 'interval_s', 'times', 'start',
    'end', 'constant', 'ramp', 'staircase', 'sinusoid', 'uniform_random', 'single', 'doublet',
    'n_let', 'pause', 'repeat',
)  # fmt: skip
SCALARS = (
    '0', '1', '-1', '010', '0100', '1:30', '1:30:00', '1_000', '0x1F', '0o17', '0b1', '0x_', '08',
    '1e-320', '1e320', '-1e320', '4.9e-324', '1e-7', '.inf', '-.inf', '.nan', '1.', '.5', '+1',
    '9' * 5000, '0.' + '0' * 5000 + '1', '1e' + '9' * 400, '9007199254740993',
    '18446744073709551616', '-9223372036854775808', 'true', 'false', 'yes', 'no', 'on', 'off', 'y',
    '~', 'null', '',
    '2001-99-99', '2001-01-01', '2001-01-01T25:61:61Z', '!!int ""', '!!bool x', '!!float z',
    '!!timestamp x', '!!binary "="', '!!set {a}', '!!omap [a]',
    '!!python/object/apply:os.system [a]',
    '!!python/name:os.system', '!<tag:yaml.org,2002:int> a', '! a', '&a 1', '*a', '<<', '=',
    '"\\ud800"', '"\\U00110000"', '"\\UFFFFFFFF"', '"\\x00"', '"\\u202e"', '"\\udfff\\ud800"',
    '"\\q"', '"\\x"', '"', "'", '"a\\\n b"', '"name"', '\ud800', '\udfff', '\ufeff', '\ufffe',
    '\u2028',
    '\x00', '\x07', '\x85', '\x7f', '\U0001f9b5', 'é', '|', '>', '|9', '>-\n x', '- ', '? ', ': ',
    '%',
    '@', '`', '#', '---', '...', '%YAML 9.9', '%TAG ! tag:x,2002:', '{', '}', '[', ']', ',', '\t',
    '../../../etc/passwd', '${HOME}', '$(reboot)', "'; drop table", '%s%n', '{0}', 'x' * 3000,
)  # fmt: skip
_VALUE = re.compile(r'(?<=: )[^,}\n]+')
LAUGHS = 'a0: &a0 [l, l]\n' + ''.join(
    f'a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n' for i in range(1, 60)
)
KNOWN = (
    '',
    'name: 2001-99-99\nsegments: [{kind: single, intensity: 1}]',
    f'seed: {"9" * 5000}\nsegments: [{{kind: single, intensity: 1}}]',
    'seed: !!int ""\nsegments: [{kind: single, intensity: 1}]',
    'seed: !!bool x\nsegments: [{kind: single, intensity: 1}]',
    'seed: 0x_\nsegments: [{kind: single, intensity: 1}]',
    'name: "\\U00110000"\nsegments: [{kind: single, intensity: 1}]',
    'name: "\\ud800"\nsegments: [{kind: single, intensity: 1}]',
    '"\\ud800": 1\nsegments: [{kind: single, intensity: 1}]',
    'segments: [{kind: single, "\\ud800": 1}]',
    '[' * 50_000,
    '{a: ' * 50_000,
    '- ' * 50_000,
    '? ' * 50_000,
    'a:\n' + ''.join(' ' * depth + '- \n' for depth in range(1, 300)),
    LAUGHS,
    'a: &a [*a]\nsegments: *a',
    '&a a: *a',
    'segments: &s [{kind: repeat, times: 2, segments: *s}]',
    'segments: [{kind: constant, rate_hz: 1e-320, duration_s: 1.0, intensity: 1}]',
    'segments: [{kind: sinusoid, rate_hz: 20.0, duration_s: 1.0, period_s: 1e-320}]',
    'segments: [{kind: constant, rate_hz: 010, duration_s: 1.0, intensity: 1}]',
    'segments: [{kind: pause, duration_s: 1:30}]',
    'segments: [{kind: single, intensity: 0.1, intensity: 1.0}]',
    'segments: [{kind: uniform_random, rate_hz: 9.0, duration_s: 1.0, low: 0.7, high: 0.4}]',
    'segments: [{kind: repeat, times: 100000, segments: [{kind: pause, duration_s: 1e-6}]}]',
    '1\n' * 50_000,
    'a: 1\n' * 40_000,
    '[' + 'a,' * 99_000 + ']',
    '{' + 'a: 1,' * 30_000 + '}',
    '"' + '\\x41' * 49_000 + '"',
    ' ' * 199_999,
    '\n' * 199_999,
    '#' * 199_999,
    '\x00' * 1000,
    '\ufeffname: x\nsegments: [{kind: single, intensity: 1}]',
    '--- \n--- \n',
    '%YAML 1.1\n---\nsegments: [{kind: single, intensity: 1}]',
    'x' * 5_000_000,
)


def sendable(text):
    """Whether a ROS string can hold the text: UTF-8 without a zero byte."""
    try:
        return b'\0' not in text.encode('utf-8')
    except UnicodeEncodeError:
        return False


def hostile_text(random):
    """Return one hostile text; most look like a schedule."""
    ways: list[Callable[[Random], str]] = [_grown, _grown, _changed, _changed, _bent, _noise]
    return random.choice(ways)(random)


def hostile_texts(count, seed=0):
    """Yield ``count`` hostile texts, those that are known first."""
    yield from KNOWN[:count]
    random = Random(seed)
    for _ in range(count - len(KNOWN)):
        yield hostile_text(random)


def _scalar(random):
    return random.choice(SCALARS if random.random() < 0.6 else WORDS)


def _key(random):
    return random.choice(WORDS) if random.random() < 0.85 else _scalar(random)


def _flow(random, depth):
    """Return a value in flow style, from the grammar of YAML."""
    if depth <= 0 or random.random() < 0.4:
        return _scalar(random)
    mark = random.choice(('', '', '', '', '!x ', '&b ', '!!map ', '!!seq '))
    items = range(random.randrange(5))
    if random.random() < 0.6:
        inner = ', '.join(f'{_key(random)}: {_flow(random, depth - 1)}' for _ in items)
        return f'{mark}{{{inner}}}'
    return f'{mark}[{", ".join(_flow(random, depth - 1) for _ in items)}]'


def _grown(random):
    """Return a document that has keys of a schedule and values of all kinds."""
    count = random.randrange(1, 7)
    lines = [f'{_key(random)}: {_flow(random, random.randrange(1, 5))}' for _ in range(count)]
    if random.random() < 0.5:
        lines.append('segments:')
        lines.extend(
            f'- {{kind: {random.choice(WORDS)}, {_key(random)}: {_scalar(random)}}}'
            for _ in range(random.randrange(1, 4))
        )
    return '\n'.join(lines)


def _changed(random):
    """Return a good schedule with one to three values replaced."""
    text = SCHEDULE
    for _ in range(random.randrange(1, 4)):
        chosen = random.choice(list(_VALUE.finditer(text)))
        new = _scalar(random) if random.random() < 0.5 else f'{random.uniform(0.0, 30.0):.3g}'
        text = f'{text[: chosen.start()]}{new}{text[chosen.end() :]}'
    return text


def _bent(random):
    """Return a good schedule with bytes changed, removed, put in, or said twice."""
    data = bytearray(SCHEDULE, 'utf-8')
    for _ in range(random.choice((1, 1, 2, 10))):
        at = random.randrange(len(data) + 1)
        match random.randrange(4):
            case 0:
                data[at : at + 1] = bytes([random.randrange(256)])
            case 1:
                del data[at : at + random.randrange(1, 30)]
            case 2:
                data[at:at] = bytes(random.choice(b' \t\n:,-[]{}&*!|>#%@"\'\\') for _ in range(3))
            case _:
                data[at:at] = data[: random.randrange(1, 200)]
        data = data or bytearray(b'-')
    return _decoded(bytes(data), random)


def _noise(random):
    return _decoded(random.randbytes(random.randrange(300)), random)


def _decoded(data, random):
    """Return bytes as text; surrogates stand for what is not UTF-8, or Latin-1 does."""
    return data.decode(*random.choice((('utf-8', 'surrogateescape'), ('latin-1', 'strict'))))
