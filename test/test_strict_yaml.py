# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML from outside: what is accepted, what is refused where, and that nothing else happens."""

import math

import pytest

from rpms_ros.strict_yaml import YamlError, clipped, read_yaml, shown


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('a: 1', 1),
        ('a: -12', -12),
        ('a: +3', 3),
        ('a: 0', 0),
        ('a: 1.5', 1.5),
        ('a: .5', 0.5),
        ('a: 100e-6', 100e-6),
        ('a: 2.0e+6', 2.0e6),
        ('a: 1e400', math.inf),
        ('a: -.inf', -math.inf),
        ('a: true', True),
        ('a: FALSE', False),
        ('a: null', None),
        ('a: ~', None),
        ('a:', None),
        # text in the core schema of YAML 1.2, not in YAML 1.1
        ('a: yes', 'yes'),
        ('a: off', 'off'),
        ('a: 2001-99-99', '2001-99-99'),
        ('a: 2026-11-21', '2026-11-21'),
        ('a: 1.2.3', '1.2.3'),
        ('a: "010"', '010'),
        ("a: '1:30'", '1:30'),
        ('a: "true"', 'true'),
        ('a: >\n  one\n  two', 'one two'),
        ('a: [1, {b: 2}]', [1, {'b': 2}]),
        ('"a": 1', 1),
        ('\ufeffa: 1', 1),
        ('---\na: 1\n...', 1),
        ('# said\na: 1 # so', 1),
    ],
)
def test_the_core_schema_of_yaml_1_2(text, value):
    content = read_yaml(text).content
    assert content == {'a': value}
    assert type(content['a']) is type(value)


def test_nan_is_a_number_that_others_have_to_refuse():
    assert math.isnan(read_yaml('a: .nan').content['a'])


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('a: 010', r'line 1, a: expected a number written in .* without leading zeros.*got .010'),
        ('a:\n- 1\n- 0100', r'line 3, a\[1\]: expected a number written in'),
        ('a: {b: 1:30}', r'line 1, a\.b: expected a number written in .* colons'),
        ('a: 1_000', 'line 1, a: expected a number written in .* underscores'),
        ('a: 0x1F', 'line 1, a: expected a number written in'),
        ('a: 0o17', 'line 1, a: expected a number written in'),
        ('a: 0x_', 'line 1, a: expected a number written in'),
        ('a: -08.5', 'line 1, a: expected a number written in'),
        (f'a: {"9" * 5000}', r'line 1, a: expected a number written in at most 40 decimal digits'),
        ('a: 1\nb: 2\na: 3', 'line 3, a: expected the key once, got it again after line 1'),
        ('a: {b: 1, b: 2}', r'line 1, a\.b: expected the key once'),
        ('a: !!int ""', r'line 1, a: expected no tag, got tag:yaml.org,2002:int'),
        ('a: !x 1', 'line 1, a: expected no tag, got !x'),
        ('a: &x 1', 'line 1, a: expected no anchor, got &x'),
        ('a: *x', 'line 1, a: expected a YAML document without aliases'),
        ('<<: {a: 1}\n<<: {b: 1}', 'line 2, <<: expected the key once'),
        ('[a]: 1', 'line 1: expected a text as key, got a list or a mapping'),
        ('? {a: 1}\n: 1', 'line 1: expected a text as key'),
        ('"": 1', "line 1: expected a key of 1 to 100 printable characters, got ''"),
        ('"\\ud800": 1', 'line 1: expected a key of 1 to 100 printable characters'),
        (f'? {"k" * 101}\n: 1', 'line 1: expected a key of 1 to 100'),
        ('a: "\\ud800"', r"line 1, a: expected printable text, got '\\ud800'"),
        ('a: "\\u202e"', 'line 1, a: expected printable text'),
        ('a: "\\x00"', 'line 1, a: expected printable text'),
        ('a: "\\U00110000"', 'line 1: expected a YAML document, got'),
        ('a: 1\nb: \ud800', 'line 2: expected printable text, got character 0xd800'),
        ('a: 1\n\x00', 'line 2: expected printable text, got character 0x0'),
        ('a: ' + 'x' * 2001, 'line 1, a: expected at most 2000 characters of text, got 2001'),
        ('a: "' + 'x' * 2001 + '"', 'line 1, a: expected at most 2000 characters of text'),
        ('a: 1\n--- \nb: 1', 'line 2: expected one YAML document, got another one'),
        ('%YAML 1.1\n---\na: 1', 'line 1: expected a YAML document without directives'),
        ('%TAG ! tag:x,2002:\n---\na: 1', 'line 1: expected a YAML document without directives'),
        ('', 'line 1: expected a YAML document, got an empty one'),
        ('# nothing', 'line 1: expected a YAML document, got an empty one'),
        ('a: 1\nb: [', 'line 2: expected a YAML document, got while parsing'),
        ('a: 1\n\tb: 2', 'line 2: expected a YAML document, got'),
        ('[' * 50_000, 'expected at most 40 levels of nesting in YAML'),
        ('- ' * 50_000, 'expected at most 40 levels of nesting in YAML'),
        ('[' + '1,' * 10_001 + ']', 'expected at most 10000 values and keys in YAML'),
        ('x' * 200_001, 'line 1: expected at most 200000 characters of YAML, got 200001'),
    ],
)
def test_everything_else_is_refused_with_line_and_key(text, fault):
    with pytest.raises(YamlError, match=fault) as caught:
        read_yaml(text)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


def test_lines_of_places():
    node = read_yaml('a: 1\nb:\n- 1\n- c: 2\n  d:\n    e: 3\n')
    lines = {'a': 1, 'b[0]': 3, 'b[1].c': 4, 'b[1].d.e': 6, 'b[1].x': 4, 'x': 1, '': 1}
    assert {place: node.line_of(place) for place in lines} == lines


def test_values_are_shown_short_and_printable():
    assert shown('true') == "'true'"
    assert shown(True) == 'True'
    assert shown('\ud800') == "'\\ud800'"
    assert shown(10**5000) == 'a number of thousands of digits'
    assert len(shown(['x'] * 1000)) < 130
    assert clipped('a\nb') == 'a\\nb'
