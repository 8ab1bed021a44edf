"""LiDARs, cameras and the reference renderer depend on each other in one direction."""

from __future__ import annotations

from import_graph import circles, folder_graph


def test_folders_form_no_circle() -> None:
    """Files beside the folders are their ground (triangles, weather) and their roof (visibility)."""
    folders = folder_graph("coopsim.sensors")
    assert len(folders) == 4
    assert circles({name: used - {"coopsim.sensors"} for name, used in folders.items()}) == []
