"""Look-up by name, and the errors of those who mistype."""

import pickle

import pytest

from coopsim.errors import DuplicateNameError, UnknownNameError
from coopsim.support.registry import Registry


@pytest.fixture
def fruit() -> Registry[int]:
    registry: Registry[int] = Registry("fruit")
    registry.register("apple")(1)
    registry.register("banana")(2)
    return registry


def test_get_returns_what_was_registered(fruit: Registry[int]) -> None:
    assert fruit.get("apple") == 1
    assert fruit.names() == ("apple", "banana")
    assert "apple" in fruit
    assert "kiwi" not in fruit


def test_duplicate_raises_and_keeps_the_first(fruit: Registry[int]) -> None:
    with pytest.raises(DuplicateNameError, match=r"fruit 'apple' is already registered"):
        fruit.register("apple")(3)
    assert fruit.get("apple") == 1


def test_an_alias_is_found_and_not_listed(fruit: Registry[int]) -> None:
    fruit.register("pear", alias="nashi")(3)
    assert fruit.get("nashi") == 3 and "nashi" in fruit
    assert fruit.names() == tuple(fruit) == ("apple", "banana", "pear")
    for taken in ("nashi", "pear"):
        with pytest.raises(DuplicateNameError, match=f"fruit '{taken}' is already registered"):
            fruit.register("plum", alias=taken)(4)
    assert "plum" not in fruit


def test_unknown_lists_close_and_accepted_names(fruit: Registry[int]) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown fruit 'aple'. Did you mean 'apple'\?.*apple, banana"):
        fruit.get("aple")


def test_home_is_imported_at_first_lookup(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "orchard_home.py").write_text(
        "import orchard_registry\norchard_registry.TREES.register('oak')('an oak')\n"
    )
    (tmp_path / "orchard_registry.py").write_text(
        "from coopsim.support.registry import Registry\nTREES = Registry('tree', home='orchard_home')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    import orchard_registry  # type: ignore[import-not-found]

    assert orchard_registry.TREES.get("oak") == "an oak"


def test_an_unknown_name_is_told_with_what_it_is_a_part_of_and_survives_pickling() -> None:
    error = UnknownNameError("parameter", "colr", ["colour"], "of fruit 'apple'").at("fruit.yaml:3")
    assert str(error).startswith("fruit.yaml:3: unknown parameter 'colr' of fruit 'apple'. Did you mean 'colour'?")
    copy = pickle.loads(pickle.dumps(error))
    assert (str(copy), copy.known, copy.place) == (str(error), ("colour",), "fruit.yaml:3")
    assert str(UnknownNameError("fruit", "fig", [])) == "unknown fruit 'fig'. There are none"


def test_aliases_of_an_entry() -> None:
    fruits = Registry[str]("fruit")
    fruits.register("apple", alias="pomme")("red")
    fruits.register("banana")("yellow")
    assert fruits.aliases_of("apple") == ("pomme",)
    assert fruits.aliases_of("banana") == ()
