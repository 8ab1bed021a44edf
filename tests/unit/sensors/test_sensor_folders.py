"""The sensors' folders depend on each other in one direction."""

from __future__ import annotations

from import_graph import circles, file_graph, module_files


def test_folders_form_no_circle() -> None:
    files = module_files()

    def folder(module: str) -> str:
        return module if files[module].name == "__init__.py" else module.rpartition(".")[0]

    folders: dict[str, set[str]] = {}
    for module, imported in file_graph().items():
        if module.startswith("coopsim.sensors"):
            others = {folder(other) for other in imported if other.startswith("coopsim.sensors")}
            folders.setdefault(folder(module), set()).update(others - {folder(module)})
    assert len(folders) == 7
    assert circles(folders) == []
