"""The check of the words that the glossary replaces."""

import importlib.util
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "tools/check_words.py"


@pytest.fixture
def tool():
    spec = importlib.util.spec_from_file_location("check_words", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_use_is_listed_with_its_line(tool, monkeypatch, tmp_path):
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    path = tmp_path / "a.md"
    # The check also reads this file.
    words = [word.replace("z", "s") for word in ("optimize", "Reoptimized", "summarizing")]
    path.write_text("\n".join((*words, "optimize, summarize, and the organism")), "utf-8")
    found = [use.split("; write")[0] for use in tool.uses(path)]
    assert found == [
        f"a.md:{line}: {word.removeprefix('Re')!r}" for line, word in enumerate(words, 1)
    ]
