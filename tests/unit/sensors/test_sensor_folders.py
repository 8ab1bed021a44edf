"""The sensors' folders depend on each other in one direction."""

from __future__ import annotations

from import_graph import circles, folder_graph


def test_folders_form_no_circle() -> None:
    folders = folder_graph("coopsim.sensors")
    assert len(folders) == 4
    assert circles(folders) == []
