"""The Chromium with which tests, screenshots, and measurements open pages."""

import os

import pytest

from chromium import launch_options


def test_the_first_chromium_on_the_path_is_launched(monkeypatch):
    found = {"chromium-browser": "/a", "google-chrome": "/b"}
    monkeypatch.setattr("shutil.which", found.get)
    monkeypatch.setattr(os, "geteuid", lambda: 1000, raising=False)
    assert launch_options() == {"executable_path": "/a", "args": []}
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert launch_options()["args"] == ["--no-sandbox"]


def test_a_missing_chromium_is_named(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(FileNotFoundError, match=r"none of chromium, .*; install chromium"):
        launch_options()
