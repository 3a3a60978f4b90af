"""All checks, by name. `nox` runs the gate; `nox --tags release` runs the slower checks.

The tags below are the only list of the gate's steps: `.ci/run` and CONTRIBUTING refer to them.
`.ci/run` runs the steps with the tag "beside", which use one core, at the same time as the last.
"""

import os
import re
import shutil
import sys
import tarfile
import time
from pathlib import Path

import nox
from nox.command import CommandFailed

nox.needs_version = ">=2024.10.9"
# uv installs packages in a fraction of pip's time.
nox.options.default_venv_backend = "uv|venv"
nox.options.reuse_existing_virtualenvs = True
nox.options.tags = ["gate"]

ROOT = Path(__file__).parent
DIST = ROOT / "dist"
DATA = Path(os.environ.get("JOTLIGHT_DATA", ROOT.parent / "shared" / "data")).resolve()
NEEDS_TORCH = (
    "tests/torch",
    "tests/cli/test_train_deep.py",
    "tests/cli/test_fine_tune.py",
    "tests/tools/test_train.py",
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SITE = ROOT / "docs" / "_build" / "html"
SLOW = "slow and not exhaustive"
PROGRAMS = "Scripts" if sys.platform == "win32" else "bin"
MANYLINUX = "manylinux_2_17_x86_64"  # manylinux2014
# uv reads other variables than pip. Each setting of pip holds for both.
SETTINGS = {
    "PIP_INDEX_URL": "UV_DEFAULT_INDEX",
    "PIP_EXTRA_INDEX_URL": "UV_INDEX",
    "PIP_FIND_LINKS": "UV_FIND_LINKS",
    "PIP_CERT": "SSL_CERT_FILE",
}
for of_pip, of_uv in SETTINGS.items():
    if of_pip in os.environ:
        os.environ.setdefault(of_uv, os.environ[of_pip])
os.environ.setdefault("UV_INDEX_STRATEGY", "unsafe-best-match")  # the rule of pip
# Otherwise each process compiles all modules of Python anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@nox.session(tags=["gate", "first"])
def lint(session: nox.Session) -> None:
    """Check the style and the lints of Python and Rust, and the words of the glossary."""
    session.install("ruff>=0.9")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("python", "tools/check_words.py")
    for tool, arguments in (
        ("rustfmt", ["fmt", "--all", "--check"]),
        ("cargo-clippy", ["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    ):
        if shutil.which(tool):
            session.run("cargo", *arguments, external=True)
        else:
            session.warn(f"{tool} is not installed: its check was NOT made")


@nox.session(venv_backend="none", tags=["gate", "first"])
def readme(session: nox.Session) -> None:
    """Run the README's test commands unchanged, in a copy of the tracked files; then slow tests."""
    copy = Path(session.create_tmp()).resolve() / "jotlight"
    shutil.rmtree(copy, ignore_errors=True)
    tracked = session.run("git", "ls-files", "-z", external=True, silent=True) or ""
    for name in filter(None, tracked.split("\0")):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    text = (copy / "README.md").read_text("utf-8").replace(".venv/bin/", f".venv/{PROGRAMS}/")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.S | re.M)
    with session.chdir(copy):
        # All sessions share this target folder, so the engine is compiled once.
        env = {"CARGO_TARGET_DIR": str(ROOT / "target"), "JOTLIGHT_DATA": str(DATA)}
        session.run("bash", "-ec", blocks[1], env=env, external=True)
        # Each core has a process of its own, so further threads of BLAS would only wait.
        slow = f".venv/{PROGRAMS}/pytest -m '{SLOW}'"
        session.run("bash", "-ec", slow, env={**env, "OPENBLAS_NUM_THREADS": "1"}, external=True)


@nox.session(venv_backend="none", tags=["gate", "first"])
def rust(session: nox.Session) -> None:
    """Run the engine's own tests, and the examples in its documentation; check its licenses."""
    session.run(sys.executable, "tools/third_party_licenses.py", external=True)
    # The session `readme` has compiled most of it already.
    session.run("cargo", "test", "--release", "--workspace", external=True)
    strict = {"RUSTDOCFLAGS": "-D warnings"}
    session.run("cargo", "doc", "--no-deps", "--workspace", env=strict, external=True)


@nox.session(tags=["gate", "first"])
def wheel(session: nox.Session) -> None:
    """Build the wheel that the sessions below install."""
    session.install("maturin>=1.9.4,<2")
    shutil.rmtree(DIST, ignore_errors=True)
    session.run("maturin", "build", "--release", "--locked", "--out", str(DIST))


@nox.session(tags=["gate", "beside"])
def types(session: nox.Session) -> None:
    """Check the types strictly, and compare the engine's stub with the compiled module."""
    install_wheel(session, "mypy>=1.13", extra="zarr")  # we derive classes from those of zarr
    session.run("mypy")
    session.run("python", "-m", "mypy.stubtest", "jotlight._engine")


@nox.session(tags=["gate", "last"])
def torch(session: nox.Session) -> None:
    """Run all tests that need PyTorch; arguments go to pytest.

    Set PIP_EXTRA_INDEX_URL to an index of CPU-only builds. Otherwise pip installs gigabytes of CUDA
    libraries that the tests do not use.
    """
    install_wheel(session, extra="test,deepinv")
    # Of the documents, only these pages need PyTorch.
    chosen = ("-m", "not exhaustive", "-k", "torch or fine_tuning or tutorial or not documents")
    # The pages take longest, so they begin first. Otherwise, files with many tests would.
    files = ("--no-loadscope-reorder", "tests/docs/test_documents.py", *NEEDS_TORCH)
    session.run("pytest", *chosen, *files, *session.posargs)


@nox.session(tags=["gate", "beside"])
def site(session: nox.Session) -> None:
    """Build the website without running the examples, and check all links between its pages."""
    build_site(session, "-D", "plot_gallery=0")


@nox.session(tags=["release"])
def gallery(session: nox.Session) -> None:
    """Build the website with the figures of the examples, and run the examples as notebooks."""
    build_site(session)
    examples = [path.stem for path in sorted((ROOT / "examples").glob("*.py"))]
    for name in examples:
        if not list((SITE / "_images").glob(f"sphx_glr_{name}_*.png")):
            session.error(f"the page of the example {name} has no figure")
    session.install("ipykernel", "nbconvert")
    notebooks = [next(SITE.glob(f"_downloads/*/{name}.ipynb")) for name in examples]
    output = ("--output-dir", session.create_tmp())
    session.run("jupyter", "nbconvert", "--to", "notebook", "--execute", *output, *notebooks)


@nox.session(venv_backend="none", tags=["release"])
def overflow(session: nox.Session) -> None:
    """Run the engine's own tests with checks for overflow of integers."""
    session.run("cargo", "test", "--workspace", external=True)


@nox.session(tags=["release"])
def release(session: nox.Session) -> None:
    """Build the manylinux2014 wheel, the sdist, and the crate; run the wheel without a compiler."""
    if sys.platform != "linux":
        session.skip("wheels for manylinux2014 are built on Linux")
    session.install("maturin[zig]>=1.9.4,<2", "auditwheel>=6", "pip")
    output = DIST / "release"
    shutil.rmtree(output, ignore_errors=True)
    options = ("--zig", "--compatibility", "manylinux2014", "--out", str(output))
    session.run("maturin", "build", "--release", "--locked", *options)
    built = next(output.glob("*.whl"))
    shown = session.run("auditwheel", "show", str(built), silent=True) or ""
    session.log(shown)
    if f'following platform tag: "{MANYLINUX}"' not in " ".join(shown.split()):
        session.error(f"auditwheel: expected {MANYLINUX}")
    session.log(f"{built.name}: {built.stat().st_size / 1e6:.1f} MB")
    run_without_compiler(session, built)
    session.run("maturin", "sdist", "--out", str(output))
    source = next(output.glob("*.tar.gz"))
    check_sdist(session, source)
    target = {"CARGO_TARGET_DIR": os.environ.get("CARGO_TARGET_DIR", str(ROOT / "target"))}
    arguments = ("--no-deps", "--wheel-dir", session.create_tmp())
    session.run("pip", "wheel", *arguments, str(source), env=target)
    session.run("cargo", "publish", "--dry-run", "--allow-dirty", "-p", "jotlight", external=True)


@nox.session(tags=["release"])
def reproduce(session: nox.Session) -> None:
    """Run all of the paper's experiments in quick mode, on the data in folder JOTLIGHT_DATA."""
    if not DATA.is_dir():
        session.skip(f"there is no data in {DATA}: the experiments were NOT run on it")
    install_wheel(session)
    output = Path(session.create_tmp()) / "reproduction"
    session.run(
        *("jotlight", "reproduce", "all", "--quick", "--data", str(DATA)),
        *("--output", str(output), "--restart"),
    )


@nox.session(tags=["release"])
def browser(session: nox.Session) -> None:
    """Test the website, the page of the reproduction, and the viewer in a browser."""
    if not any(map(shutil.which, BROWSERS)):
        session.error(f"none of {', '.join(BROWSERS)} is installed: no page was tested")
    if not (SITE / "index.html").exists():
        session.error(f"there is no website in {SITE}: run `nox -s gallery` first")
    install_wheel(session, extra="test,browser")
    tests = (
        "tests/experiments/report/test_page_browser.py",
        "tests/docs/test_site_browser.py",
        "tests/view/page",
    )
    session.run("pytest", "-m", "slow", *tests, *session.posargs, env={"JOTLIGHT_SITE": str(SITE)})


@nox.session(tags=["release"])
def napari(session: nox.Session) -> None:
    """Test the napari plugin in an offscreen Qt."""
    install_wheel(session, "PyQt6>=6.6", extra="test,napari")
    # The pytest plugins of napari and npe2 issue warnings, which the tests treat as errors.
    plugins = ("-p", "no:napari", "-p", "no:npe2")
    session.run(
        *("pytest", *plugins, "-m", "slow or not slow", "tests/napari"),
        *session.posargs,
        env={"QT_QPA_PLATFORM": "offscreen"},
    )


@nox.session(tags=["release"])
def exhaustive(session: nox.Session) -> None:
    """Run the tests that check all cases where those of the gate check some, and those of S3."""
    install_wheel(session, extra="test,test-s3")
    session.run("pytest", "-m", "exhaustive", *session.posargs, env={"JOTLIGHT_DATA": str(DATA)})


@nox.session(venv_backend="uv", tags=["release"])
def lowest(session: nox.Session) -> None:
    """Run the fast tests with the lowest versions of all packages that pyproject.toml permits."""
    session.install("--resolution", "lowest-direct", "-r", "pyproject.toml", "--extra", "test")
    session.install("--no-deps", "--reinstall", str(built_wheel(session)))
    # Old versions use functions of other packages that are deprecated by now.
    options = ("-W", "ignore::DeprecationWarning", *session.posargs)
    session.run("pytest", *options, env={"JOTLIGHT_DATA": str(DATA)})


@nox.session(tags=["release"])
def fuzz(session: nox.Session) -> None:
    """Fuzz every file reader for a few seconds; arguments go to fuzz/readers.py."""
    try:
        install_wheel(session, "atheris>=3", extra="test")
    except CommandFailed:
        session.error("atheris cannot be installed here: the readers were NOT fuzzed")
    session.run("python", "fuzz/readers.py", *(session.posargs or ["all", "--seconds", "5"]))


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests that the arguments select, such as `nox -s tests -- -k sensor`."""
    install_wheel(session, extra="test")
    session.run("pytest", *session.posargs, env={"JOTLIGHT_DATA": str(DATA)})


def build_site(session: nox.Session, *options: str) -> None:
    """Build the website from nothing, with warnings as errors, and check its links."""
    install_wheel(session, extra="site")
    for generated in ("_build", "api", "gallery"):
        shutil.rmtree(ROOT / "docs" / generated, ignore_errors=True)
    session.run("sphinx-build", "-W", "--keep-going", *options, "docs", str(SITE))
    session.run("python", "tools/check_site.py", str(SITE))


def run_without_compiler(session: nox.Session, built: Path) -> None:
    """Install a wheel in an environment whose path holds no Rust toolchain, and run it."""
    folder = Path(session.create_tmp()).resolve()
    shutil.rmtree(folder / "installed", ignore_errors=True)
    session.run("python", "-m", "venv", str(folder / "installed"))
    programs = folder / "installed" / PROGRAMS
    bare = {"PATH": str(programs)}
    code = "import shutil; assert shutil.which('cargo') is None is shutil.which('rustc')"
    session.run(str(programs / "python"), "-c", code, env=bare, external=True)
    arguments = ("install", "--quiet", "--only-binary", ":all:", str(built))
    session.run(str(programs / "pip"), *arguments, env=bare, external=True)
    with session.chdir(folder):
        for command in (["jotlight", "demo"], ["python", "-c", "import jotlight"]):
            # The first run of Python also compiles the modules to bytecode.
            for run in ("first", "second"):
                start = time.perf_counter()
                session.run(str(programs / command[0]), *command[1:], env=bare, external=True)
                session.log(f"{run} run: {time.perf_counter() - start:.2f} s")


def check_sdist(session: nox.Session, source: Path) -> None:
    """Compare the files of an sdist with the tracked ones, except hidden ones."""
    with tarfile.open(source) as archive:
        found = {name.partition("/")[2] for name in archive.getnames()} - {"PKG-INFO"}
    tracked = session.run("git", "ls-files", "-z", external=True, silent=True) or ""
    expected = {name for name in tracked.split("\0") if name and not name.startswith(".")}
    if found != expected:
        session.error(f"the sdist and git differ in {', '.join(sorted(found ^ expected))}")


def install_wheel(session: nox.Session, *others: str, extra: str = "") -> None:
    """Install the wheel that the session `wheel` built, and other packages."""
    wheel = str(built_wheel(session))
    session.install(f"{wheel}[{extra}]" if extra else wheel, *others)
    session.install("--quiet", "--force-reinstall", "--no-deps", wheel)


def built_wheel(session: nox.Session) -> Path:
    """Return the wheel that the session `wheel` built."""
    wheels = sorted(DIST.glob("jotlight-*.whl"))
    if len(wheels) != 1:
        session.error(f"expected one wheel in {DIST}, got {len(wheels)}: run `nox -s wheel` first")
    return wheels[0]
