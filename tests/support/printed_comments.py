"""Comments in the code of pages that state what a `print` prints.

The comment stands on the last line of the call, or alone on the line below it.
"""

import ast
import builtins
import collections
import io
import re
import sys
import tokenize
from typing import Any

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def run_block(code: str, name: str, names: dict[str, Any]) -> dict[int, str]:
    """Run a block of code, and return what the calls of `print` in each of its lines printed."""
    printed: dict[int, str] = collections.defaultdict(str)

    def record(*values: object, **options: Any) -> None:
        stream = io.StringIO()
        builtins.print(*values, file=stream, **options)
        printed[sys._getframe(1).f_lineno] += stream.getvalue()

    names["print"] = record
    exec(compile(code, name, "exec"), names)
    return printed


def stated_prints(code: str) -> dict[int, str]:
    """Return the comment that states the output of each call of `print`, by its first line."""
    comments = {
        token.start[0]: token
        for token in tokenize.generate_tokens(io.StringIO(code).readline)
        if token.type == tokenize.COMMENT
    }
    stated = {}
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "print":
            below = comments.get(node.end_lineno + 1)
            is_alone = below is not None and below.line.lstrip().startswith("#")
            comment = comments.get(node.end_lineno) or (below if is_alone else None)
            if comment is not None:
                stated[node.lineno] = comment.string.removeprefix("#").strip()
    return stated


def agrees(stated: str, printed: str) -> bool:
    """Return whether a printed text contains a stated one.

    White space does not matter, and `...` stands for any text. A number may differ by 1 in its last
    digit, because processors round differently.
    """
    stated, printed = " ".join(stated.split()), " ".join(printed.split())
    literal = re.escape(stated).replace(re.escape("..."), ".*")
    pattern = r"(?<![\w.])" + re.sub(r"\d+(?:\\\.\d+)?", lambda _: f"({_NUMBER.pattern})", literal)
    numbers = _NUMBER.findall(stated)
    return any(
        all(map(_is_close, numbers, found.groups())) for found in re.finditer(pattern, printed)
    )


def _is_close(stated: str, printed: str) -> bool:
    digits, others = (len(number.partition(".")[2]) for number in (stated, printed))
    return digits == others and abs(float(stated) - float(printed)) < 1.5 * 10.0**-digits
