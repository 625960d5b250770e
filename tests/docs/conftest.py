"""The documentation's pages and the code in them."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

CodeBlocks = Callable[[str, str], list[str]]


@pytest.fixture(scope="session")
def repository() -> Path:
    return Path(__file__).parents[2]


@pytest.fixture(scope="session")
def code_blocks(repository: Path) -> CodeBlocks:
    """The fenced blocks of a page in a language."""

    def blocks(page: str, language: str) -> list[str]:
        text = (repository / page).read_text(encoding="utf-8")
        return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)

    return blocks
