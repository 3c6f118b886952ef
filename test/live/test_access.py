# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Who may look and who may stop."""

import pytest

from rpms_ros.errors import LiveError
from rpms_ros.live.server import Access, token_of

TOKEN = 'correct horse battery'


@pytest.mark.parametrize(
    'host',
    ['127.0.0.1', '127.0.0.1:8765', 'localhost:1', '[::1]:8765', '192.168.0.7:80', 'LAB-PC:8765'],
)
def test_addresses_and_allowed_names_are_answered(host):
    assert Access(hosts=('lab-pc',)).knows_host(host)


@pytest.mark.parametrize(
    'host',
    ['', 'evil.example', 'evil.example:8765', 'localhost.evil.example', '127.0.0.1.evil.example',
     'a@127.0.0.1', '127.0.0.1/', '127.0.0.1:x', '[::1', '127.0.0.1 evil', '::1', '0x7f.1'],
)  # fmt: skip
def test_names_that_could_be_made_to_point_here_are_not(host):
    assert not Access().knows_host(host)


def test_a_request_of_another_page_is_told_from_the_page_s_own():
    own = '127.0.0.1:8765'
    assert Access.same_origin(None, own)
    assert Access.same_origin(f'http://{own}', own)
    foreign = ('http://evil.example', 'null', '', 'http://127.0.0.1:8766', 'file://', 'http://[')
    assert not any(Access.same_origin(one, own) for one in foreign)


def test_only_the_token_stops():
    access = Access(TOKEN)
    assert access.may_stop(f'Bearer {TOKEN}')
    wrong = ('Bearer ', f'Bearer {TOKEN}x', TOKEN, f'Basic {TOKEN}', 'Bearer é\udcff')
    assert not any(access.may_stop(one) for one in (None, '', *wrong))
    # a page without a token cannot be stopped by an empty one
    assert not Access().may_stop('Bearer ')


@pytest.mark.parametrize('token', ['short', 'x' * 201])
def test_a_token_that_can_be_guessed_or_is_none_is_refused(token):
    with pytest.raises(LiveError, match='expected a token of 16 to 200 characters, got'):
        Access(token)


def test_a_token_file_is_of_its_owner_alone(tmp_path):
    path = tmp_path / 'token'
    path.write_text(f'{TOKEN}\n')
    path.chmod(0o644)
    with pytest.raises(LiveError, match='readable by its owner only, got mode 644'):
        token_of(path)
    path.chmod(0o600)
    assert token_of(path) == TOKEN
    path.write_text('\n')
    with pytest.raises(LiveError, match=r'expected a token in .*, got an empty file'):
        token_of(path)
    with pytest.raises(LiveError, match='expected a file with a token, got'):
        token_of(tmp_path)
