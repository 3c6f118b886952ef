# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Services that save the state of an identifier to a file, and load it.

Any node of the graph may call a service: paths are limited to the folder in the parameter
`state_folder`, and without it both services refuse.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node

from rpms_msgs.srv import StateFile
from rpms_ros.errors import NodeError
from rpms_ros.errors import RpmsError
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.plain_text import plain_text

_LONGEST_PATH = 255
Act = Callable[[Path], None]


class StateServices:
    """Serves `~/save_state` and `~/load_state` for a node.

    Parameters
    ----------
    node : Node
        Node that serves them.
    folder : str
        Folder of the files; empty: both services refuse.
    save, load : callable
        Called with the path of a file; raise RpmsError.

    Raises
    ------
    NodeError
        If the folder does not exist.
    """

    def __init__(self, node: Node, folder: str, save: Act, load: Act) -> None:
        self._node = node
        self._folder = Path(folder).expanduser().resolve() if folder else None
        if self._folder is not None and not self._folder.is_dir():
            raise NodeError(f'parameter state_folder: expected a folder, got {folder!r}')
        node.create_service(StateFile, '~/save_state', self._answering('saved to', save))
        node.create_service(StateFile, '~/load_state', self._answering('loaded from', load))

    def _answering(
        self, done: str, act: Act
    ) -> Callable[[StateFile.Request, Any], StateFile.Response]:
        def answer(request: StateFile.Request, response: StateFile.Response) -> StateFile.Response:
            try:
                path = self._path(request.path)
                act(path)
            except RpmsError as error:
                response.message = plain_text(error)
                logger_of(self._node).warning(f'refused: {response.message}')
                return response
            response.success, response.message = True, plain_text(f'{done} {path}')
            logger_of(self._node).info(response.message)
            return response

        return answer

    def _path(self, asked: str) -> Path:
        """Return the requested file, symbolic links resolved."""
        if self._folder is None:
            raise NodeError('expected parameter state_folder, in which states are kept, got none')
        if not (0 < len(asked) <= _LONGEST_PATH and asked.isprintable()):
            raise NodeError(
                f'expected a path of 1 to {_LONGEST_PATH} printable characters, got {len(asked)}'
            )
        refused = NodeError(f'expected a file within {self._folder}, got {asked}')
        try:
            path = (self._folder / asked).resolve()
        except (OSError, RuntimeError) as error:
            # a link that leads to itself; what a callback raises would end the node
            raise refused from error
        if path == self._folder or not path.is_relative_to(self._folder):
            raise refused
        return path
