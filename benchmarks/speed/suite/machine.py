"""The machine and the software of a run."""

import datetime as dt
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[3]
PACKAGES = (
    "numpy",
    "scipy",
    "torch",
    "onnxruntime",
    "openvino",
    "opencv-python-headless",
    "scikit-image",
    "bm3d",
    "photoncube",
)
INSTRUCTIONS = "sse4_2", "avx2", "fma", "avx512f", "avx512bw", "avx512_bf16", "amx_bf16"


def facts() -> dict[str, object]:
    import jotlight

    return {
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "processor": processor(),
        "instructions": instructions(),
        "level": jotlight._engine.cpu_level(),
        "cores": cores(),
        "memory_gib": memory() / 2**30,
        "load": load(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "jotlight": jotlight.__version__,
        "commit": commit(),
        "packages": {name: version(name) for name in PACKAGES},
    }


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor() -> str:
    return cpuinfo("model name") or platform.processor() or platform.machine()


def instructions() -> list[str]:
    """Return the vector instructions that matter for jotlight or for other programs."""
    known = set(cpuinfo("flags").split())
    return [name for name in INSTRUCTIONS if name in known]


def cpuinfo(name: str) -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return next((line.split(":")[1].strip() for line in lines if line.startswith(name)), "")


def memory() -> int:
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def load() -> float | None:
    """Return the mean number of running processes in the last minute, near 0 on a quiet machine."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def commit() -> str:
    """Return the commit, with a plus if files differ from it, or "" outside of a checkout."""
    try:
        name = git("rev-parse", "--short=12", "HEAD")
        return name + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def git(*words: str) -> str:
    command = ["git", "-C", str(ROOT), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
