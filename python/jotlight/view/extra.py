"""The extra ``view``: the packages of the server."""

from importlib.util import find_spec

from jotlight.errors import MissingExtraError


def require_server() -> None:
    """Raise MissingExtraError unless the packages of the server are installed."""
    missing = [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"the viewer needs {', '.join(missing)}, not installed: pip install 'jotlight[view]'"
        )
