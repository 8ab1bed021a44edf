"""Contract of import-linter: modules are in groups, and a group imports only those that it may.

`pyproject.toml` has the groups; `lint-imports` checks them, and so does `make lint`. All imports count: those in
functions, and those for type checkers, because a file that names a type of another group cannot be read without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output
from importlinter.application import contract_utils

OWN = ".__init__"


class _Lists(fields.Field[Mapping[str, tuple[str, ...]]]):
    """Lists of texts by name: a table of TOML."""

    def parse(self, raw_data: Any) -> Mapping[str, tuple[str, ...]]:
        if not isinstance(raw_data, dict) or not all(isinstance(each, list) for each in raw_data.values()):
            raise fields.ValidationError(f"must be a table of lists, got {raw_data!r}")
        return {name: tuple(each) for name, each in raw_data.items()}


class Walls(Contract):
    """Groups of modules, and the walls between them.

    Options:
        groups: packages by group, each with all below it; the longest that fits decides. `package.__init__` is the
            package's own file alone.
        may_import: groups that a group may import, besides itself.
        ignore_imports: exemptions, as "importer -> imported"; one that is not needed is an error.
    """

    type_name = "walls"

    groups = _Lists()
    may_import = _Lists()
    ignore_imports = fields.SetField(subfield=fields.ImportExpressionField(), required=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Return the faults: modules in no group, packages that are not there, imports over a wall."""
        groups: Any = self.groups
        allowed: Any = self.may_import
        contract_utils.remove_ignored_imports_and_report(
            graph=graph,
            ignore_imports=self.ignore_imports,
            unmatched_alerting=contract_utils.AlertLevel.ERROR,
        )
        group_of = {entry: group for group, entries in groups.items() for entry in entries}
        found = {module: _find(module, group_of) for module in graph.modules}
        empty = group_of.keys() - found.values()
        faults = [f"{module} is in no group" for module, entry in found.items() if entry is None]
        faults += [f"{entry} ({group_of[entry]}) holds no module" for entry in empty]
        for module, entry in found.items():
            for imported in graph.find_modules_directly_imported_by(module):
                behind = found[imported]
                if entry is None or behind is None:
                    continue
                here, there = group_of[entry], group_of[behind]
                if here != there and there not in allowed.get(here, ()):
                    details = graph.get_import_details(importer=module, imported=imported)
                    at = ", ".join(str(line) for line in sorted(each["line_number"] for each in details))
                    faults.append(f"{module}:{at} ({here}) imports {imported} ({there})")
        return ContractCheck(kept=not faults, metadata={"faults": sorted(faults)})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the faults."""
        for fault in check.metadata["faults"]:
            output.print_error(fault)


def _find(module: str, entries: Mapping[str, str]) -> str | None:
    """Return the entry that a module belongs to: its own file, or the longest package that it is in."""
    if module + OWN in entries:
        return module + OWN
    parts = module.split(".")
    packages = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((package for package in packages if package in entries), None)
