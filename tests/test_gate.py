"""The sessions of the gate: `nox` finds them by one tag, and `.ci/run` by the times they run at."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
TIMES = {"first", "beside", "last"}


def tags_of_sessions():
    """Return the tags of each session of noxfile.py."""
    tree = ast.parse((ROOT / "noxfile.py").read_text("utf-8"))
    return {
        function.name: set(ast.literal_eval(option.value))
        for function in tree.body
        if isinstance(function, ast.FunctionDef)
        for decorator in function.decorator_list
        if isinstance(decorator, ast.Call)
        for option in decorator.keywords
        if option.arg == "tags"
    }


def test_the_gate_runs_each_of_its_sessions_once():
    sessions = tags_of_sessions()
    assert {"lint", "rust", "torch", "release"} <= set(sessions)
    for name, tags in sessions.items():
        assert len(tags & TIMES) == ("gate" in tags), name
    program = (ROOT / ".ci/run").read_text("utf-8")
    assert all(program.count(f"--tags {time}") == 1 for time in TIMES)
