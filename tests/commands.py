"""Command lines in this process."""

import sys

import pytest


def exit_code(monkeypatch, main, *words):
    """That with which `main` ends, given a command line."""
    monkeypatch.setattr(sys, "argv", list(map(str, words)))
    with pytest.raises(SystemExit) as stopped:
        main()
    return stopped.value.code
