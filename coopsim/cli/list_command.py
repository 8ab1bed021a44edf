"""`coopsim list`."""

from __future__ import annotations

import argparse

from coopsim.cli.arguments import Command, as_json
from coopsim.cli.listing import Entry, listing
from coopsim.support.checks import require_choice


def _add_list(parser: argparse.ArgumentParser) -> None:
    help_of_kind = "policies, environments, detectors, ...: its entries with a line each (default: the names of all)"
    parser.add_argument("kind", nargs="?", metavar="KIND", help=help_of_kind)
    parser.add_argument("--json", action="store_true", help="print names, descriptions and more as JSON")


def _run_list(options: argparse.Namespace) -> int:
    kinds = listing()
    if options.kind is not None:
        require_choice("kind", options.kind, (*kinds, *(kind.replace(" ", "-") for kind in kinds if " " in kind)))
        kinds = {options.kind: kinds[options.kind.replace("-", " ")]}
    found = {kind: entries() for kind, entries in kinds.items()}
    if options.json:
        print(as_json(found if options.kind is None else found[options.kind]), end="")
    elif options.kind is None:
        for kind, entries in found.items():
            print(f"{kind + ':':<16}{', '.join(map(_short, entries)) or '(none)'}")
    else:
        _print_lines(found[options.kind])
    return 0


def _short(entry: Entry) -> str:
    """Return a name with its second names, or a codec's with its content."""
    if "content" in entry:
        return f"{entry['name']} ({entry['content']})"
    return f"{entry['name']} (or {', '.join(entry['aliases'])})" if "aliases" in entry else str(entry["name"])


def _print_lines(entries: list[Entry]) -> None:
    width = max((len(_short(entry)) for entry in entries), default=0)
    for entry in entries:
        uplink = f"{entry['uplink']:<12}" if "uplink" in entry else ""
        print(f"{_short(entry):<{width}}  {uplink}{entry['description']}".rstrip())


LIST = Command(
    "list what is registered or shipped: policies, environments, detectors, uplinks, codecs, ...",
    _add_list,
    _run_list,
    ("coopsim list", "coopsim list policies", "coopsim list environments --json"),
)
