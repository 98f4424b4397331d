"""Hooks of MkDocs (.ci/mkdocs.yml): the documents are written for the Markdown of GitHub, which differs in three points."""

from __future__ import annotations

import posixpath
import re
from typing import Any

from markdown import Extension, Markdown


class TwoSpaces(Extension):
    """What belongs to an item of a list is indented by two spaces, in place of four."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Set the width of an indentation."""
        md.tab_length = 2


def on_config(config: Any) -> Any:
    """Add the extension."""
    config["markdown_extensions"].append(TwoSpaces())
    return config


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """Lead links to files outside of docs to the repository, and take the backslash from a bar in a table."""

    def link(found: re.Match[str]) -> str:
        folder = posixpath.dirname(page.file.src_uri)
        path = posixpath.normpath(posixpath.join(folder, found[1]))
        return f"]({config['repo_url']}/blob/main/{path[3:]})" if path.startswith("../") else found[0]

    lines = re.sub(r"\]\(([^():\s]+)\)", link, markdown).split("\n")
    return "\n".join(line.replace(r"\|", "|") if line.startswith("|") else line for line in lines)
