# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How Sphinx builds the site: `make docs`, which fails at the first warning."""

import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(DOCS))

import generate  # noqa: E402

import rpms_ros  # noqa: E402

SOURCE = 'https://github.com/rpms-ros/rpms_ros/blob/main'

project = 'rpms_ros'
author = 'rpms_ros contributors'
copyright = author  # noqa: A001
version = release = rpms_ros.__version__

extensions = ['myst_nb', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx_copybutton']
exclude_patterns = ['reproduction']
root_doc = 'index'

html_theme = 'pydata_sphinx_theme'
html_title = 'rpms_ros'
html_theme_options = {
    'show_toc_level': 2,
    'navigation_with_keys': False,
    'show_prev_next': True,
    'secondary_sidebar_items': ['page-toc'],
    'footer_start': ['copyright'],
    'footer_end': [],
}
html_show_sourcelink = False
html_extra_path = ['identify.schema.json']

myst_enable_extensions = ['colon_fence']
myst_heading_anchors = 4
# A notebook runs whenever the site is built; an exception in one ends the build.
nb_execution_mode = 'force'
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_show_tb = True

# What stands in single back quotes in a docstring is a name.
default_role = 'code'
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_typehints_format = 'short'
autodoc_class_signature = 'separated'
python_use_unqualified_type_names = True
napoleon_use_ivar = True
copybutton_prompt_text = '$ '
copybutton_only_copy_prompt_lines = True
# Type names of ROS and numpy are not looked up: the site is built without a network.
nitpicky = False

_LINK = re.compile(r'(\]\()(?!https?:|#|mailto:)([^)\s]+)(\))')


def link_to_source(_app: Any, docname: str, content: list[str]) -> None:
    """Let links that leave the site lead to the file in the repository.

    What does not exist stays as it is, and is a warning, which ends the build.
    """
    folder = (DOCS / docname).parent

    def target(found: re.Match[str]) -> str:
        path, _, anchor = found[2].partition('#')
        file = (folder / path).resolve()
        outside = not file.is_relative_to(DOCS) or file.is_dir() or file.suffix == '.py'
        if not path or not outside or not file.exists():
            return found[0]
        place = file.relative_to(ROOT).as_posix()
        return f'{found[1]}{SOURCE}/{place}{"#" if anchor else ""}{anchor}{found[3]}'

    content[0] = _LINK.sub(target, content[0])


def describe_fields(
    _app: Any, what: str, _name: str, one: Any, _options: Any, lines: list[str]
) -> None:
    """Add the fields of a dataclass that are described in the class, not in its docstring."""
    if what != 'class' or not dataclasses.is_dataclass(one):
        return
    fields = [field for field in dataclasses.fields(one) if field.metadata.get('doc')]
    if fields:
        lines += ['', *(f':ivar {field.name}: {field.metadata["doc"]}' for field in fields), '']


def setup(app: Any) -> None:
    """Write the generated pages, then build."""
    generate.write(DOCS / 'reference' / 'generated')
    app.connect('source-read', link_to_source)
    app.connect('autodoc-process-docstring', describe_fields)
