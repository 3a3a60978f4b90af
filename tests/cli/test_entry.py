"""The entry point: output that the encoding of the standard output cannot represent."""

import os
import subprocess
import sys

import numpy as np
import pytest

import jotlight as jl


def run_encoded(encoding, *arguments):
    """Return what a command prints to a standard output of an encoding, which is no terminal."""
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "jotlight", *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.decode(encoding)


@pytest.mark.slow
def test_help_is_complete_where_the_encoding_lacks_characters():
    whole = run_encoded("utf-8", "simulate", "--help")
    assert "K̂: each pixel" in whole
    for encoding in ("ascii", "cp1252"):
        output = run_encoded(encoding, "simulate", "--help")
        assert "K?: each pixel" in output
        assert whole.splitlines()[-2].strip("│ ") == output.splitlines()[-2].strip("| ")


@pytest.mark.slow
def test_names_that_are_no_text_keep_their_bytes(tmp_path):
    jl.save(jl.Bits.from_array(np.eye(8, dtype=bool)[None]), tmp_path / "a.npy")
    name = os.fsencode(tmp_path) + b"/p\xe9.h5"
    command = [sys.executable, "-m", "jotlight", "convert", str(tmp_path / "a.npy"), "-o", name]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:surrogateescape"}
    done = subprocess.run(command, env=environment, capture_output=True, check=True)
    assert b"p\xe9.h5" in done.stdout


@pytest.mark.slow
def test_a_name_that_the_encoding_lacks_is_no_failure(tmp_path):
    path = tmp_path / "a.npy"
    jl.save(jl.Bits.from_array(np.eye(8, dtype=bool)[None]), path)
    assert "?2.h5" in run_encoded("cp1252", "convert", path, "-o", tmp_path / "日2.h5")
    assert (tmp_path / "日2.h5").exists()
