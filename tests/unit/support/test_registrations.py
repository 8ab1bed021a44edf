"""Parts of a script and of modules, sent to a process that does not know them."""

from __future__ import annotations

import pickle
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.script_parts import forget, parts_of_a_script

from coopsim.interfaces.defense import DEFENSES
from coopsim.support.registrations import added_parts, pack_registrations, register_packed
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at, load_source

NAME = "of_the_script"

MODULE = """
from coopsim.interfaces.defense import DEFENSES, Defense

@DEFENSES.register("{}")
class A(Defense): pass
"""


def test_a_class_of_the_script_is_known_where_it_was_sent() -> None:
    with parts_of_a_script():
        assert (DEFENSES, NAME, "__main__") in added_parts()
        packed = pack_registrations()
        forget(NAME)
        register_packed(packed)
        register_packed(packed)  # as each task of a Ray does
        assert DEFENSES.get(NAME)().judge(None) == (0.25, True)  # type: ignore[arg-type, comparison-overlap]


def test_a_class_of_a_module_is_known_where_it_was_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = MODULE.format("of_a_module")
    (tmp_path / "a_module_of_mine.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    __import__("a_module_of_mine")
    packed = pack_registrations()
    forget("of_a_module")
    del sys.modules["a_module_of_mine"]
    register_packed(packed)
    assert DEFENSES.get("of_a_module") is sys.modules["a_module_of_mine"].A
    forget("of_a_module")


def test_a_class_of_a_file_is_known_where_it_was_sent(tmp_path: Path) -> None:
    text = MODULE.format("of_a_file")
    module = load_source(str(tmp_path / "of_a_file.py"), text)
    packed = pack_registrations()
    forget("of_a_file")
    del sys.modules[module.__name__]
    load_source.cache_clear()
    register_packed(packed)
    assert DEFENSES.get("of_a_file") is sys.modules[module.__name__].A
    forget("of_a_file")


def test_what_cannot_be_sent_is_told_and_hinders_nothing() -> None:
    registry: Registry[Any] = Registry("fruit")
    registry.register("of_the_test")(threading.Lock())
    with parts_of_a_script():
        with pytest.warns(UserWarning, match="the fruit 'of_the_test' cannot be sent to worker processes"):
            packed = pack_registrations()
        forget(NAME)
        register_packed(packed)
        assert NAME in DEFENSES


def test_nothing_of_the_library_is_sent() -> None:
    DEFENSES.names()
    assert not [name for registry, name, _ in added_parts() if registry is DEFENSES]


def test_a_registry_of_a_module_is_pickled_as_its_place() -> None:
    assert pickle.loads(pickle.dumps(DEFENSES)) is DEFENSES


def test_a_file_may_import_what_is_beside_it(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("class Base: pass")
    (tmp_path / "a_file_with_more.py").write_text("from beside_it import Base\nclass Mine(Base): pass")
    assert class_at("thing", f"{tmp_path}/a_file_with_more.py:Mine", object).__name__ == "Mine"


def test_modules_of_two_folders_are_not_mistaken(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "helping_it.py").write_text(f"name = {folder!r}")
    text = "from helping_it import name"
    assert load_source(f"{tmp_path}/one/mine.py", text).name == "one"
    with pytest.raises(Exception, match=r"'helping_it' that it imports is taken by .*one/helping_it.py"):
        load_source(f"{tmp_path}/other/mine.py", text)
