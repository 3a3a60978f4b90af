"""Errors and warnings."""

import importlib
import sys
import threading
import warnings

import pytest

from jotlight.errors import (
    JotlightWarning,
    MissingExtraError,
    PeriodicRatesWarning,
    error_message,
    hide_warnings,
    import_extra,
    warn,
)


def test_warnings_with_a_text_are_hidden():
    with hide_warnings("no valid bit"):
        warn("2 pixels have no valid bit")
        with pytest.warns(JotlightWarning, match="clipped"):
            warn("most pixels are clipped")
        with hide_warnings("clipped"):
            warn("2 pixels have no valid bit")
            warn("most pixels are clipped")
    with hide_warnings():
        warn("anything", PeriodicRatesWarning)
    with pytest.warns(JotlightWarning, match="no valid bit"):
        warn("2 pixels have no valid bit")


def test_an_error_ends_the_hiding():
    with pytest.raises(ZeroDivisionError), hide_warnings():
        raise ZeroDivisionError
    with pytest.warns(JotlightWarning):
        warn("anything")


def test_warnings_are_hidden_in_one_thread_only():
    inside, done, filters = threading.Event(), threading.Event(), list(warnings.filters)

    def hide():
        with hide_warnings():
            inside.set()
            done.wait(10)

    thread = threading.Thread(target=hide)
    thread.start()
    assert inside.wait(10)
    try:
        assert warnings.filters == filters
        with pytest.warns(JotlightWarning):
            warn("anything")
    finally:
        done.set()
        thread.join()


def test_without_deepinv_the_error_of_its_adapters_names_the_extra(monkeypatch):
    pytest.importorskip("torch")
    monkeypatch.delitem(sys.modules, "jotlight.torch.deepinv", raising=False)
    monkeypatch.setitem(sys.modules, "deepinv", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'jotlight\[deepinv\]'"):
        importlib.import_module("jotlight.torch.deepinv")


def test_an_import_that_fails_is_not_called_a_missing_package(tmp_path, monkeypatch):
    (tmp_path / "own_broken_wand.py").write_text("raise ImportError('libwand.so.2: not found')")
    (tmp_path / "own_incomplete_wand.py").write_text("import own_missing_part")
    monkeypatch.syspath_prepend(tmp_path)
    for name, cause in (
        ("own_broken_wand", r"libwand\.so\.2: not found"),
        ("own_incomplete_wand", "No module named 'own_missing_part'"),
    ):
        text = rf"^{name} is installed, but its import failed \({cause}\); repair its"
        with pytest.raises(ImportError, match=text) as info:
            import_extra(name, "magic", "spells")
        assert type(info.value) is ImportError


def test_a_current_folder_that_is_gone_is_named(tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    lost = FileNotFoundError(2, "No such file or directory")
    assert error_message(lost) == "No such file or directory"
    folder.rmdir()
    assert error_message(lost).startswith("the current folder does not exist any more; change to")
    monkeypatch.chdir(tmp_path)
