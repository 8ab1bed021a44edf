"""Weights in files: what is written is what is read, and nothing broken is taken for a network."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.learn import weights
from coopsim.learn.tensor_file import read_header, write_tensors
from coopsim.learn.weights import (
    card,
    digest,
    encoder_digest,
    find_weights,
    load_cooperative,
    load_covariance,
    load_detector,
    load_detector_of,
    load_integrated,
    load_picture_identity,
    load_pictures,
    load_point_identity,
    load_points_and_pictures,
    load_queries,
    load_ranking,
    make_network,
    read_texts,
    save_weights,
    shipped_weights,
)

TINY = {"pillar_features": 8, "channels": [8, 8, 8], "layers": [0, 0, 0], "features": 8}
FIRST = "encoder.points.weight"
FUSION = {"fusion": "attfuse", "message_channels": 4, "features": 8}


@pytest.fixture
def detector(tmp_path: Path) -> Path:
    net = make_network("detector", TINY, seed=3)
    path = tmp_path / "tiny.safetensors"
    save_weights(path, net, {"kind": "detector", "config": asdict(net.config)})
    return path


def cooperative(folder: Path, detector: Path) -> Path:
    net = make_network("cooperative", FUSION, seed=4)
    path = folder / "fused.safetensors"
    trained = {"detector": str(detector), "encoder_digest": encoder_digest(load_detector(detector))}
    save_weights(path, net, {"kind": "cooperative", "config": asdict(net.config), **trained})
    return path


def test_weights_are_the_same_to_half_precision_and_loaded_once(detector: Path) -> None:
    net, loaded = make_network("detector", TINY, seed=3), load_detector(detector)
    for name, value in net.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value.half().to(value.dtype))
    assert load_detector(str(detector)) is loaded
    assert not loaded.training and not any(each.requires_grad for each in loaded.parameters())


def test_a_fusion_is_loaded_for_its_encoder_alone(detector: Path, tmp_path: Path) -> None:
    path = cooperative(tmp_path, detector)
    assert load_cooperative(path, load_detector(detector)).expand is not None
    with pytest.raises(InvalidValueError, match="trained on another encoder"):
        load_cooperative(path, make_network("detector", TINY, seed=5))
    with pytest.raises(InvalidValueError, match="must be weights of the kind 'detector', is 'cooperative'"):
        load_detector(path)


def test_a_fusion_finds_the_detector_it_was_trained_on(detector: Path, tmp_path: Path) -> None:
    away = tmp_path / "away"
    away.mkdir()
    path = cooperative(away, detector)
    assert load_detector_of(path) is load_detector(detector), "where it was in training"
    moved = detector.rename(away / detector.name)
    assert load_detector_of(path) is load_detector(moved), "beside the fusion, which has moved with it"
    gone = moved.rename(tmp_path / "other.safetensors")
    with pytest.raises(
        InvalidValueError, match=r"trained on .*tiny.* neither beside it nor shipped; name it: detector_w"
    ):
        load_detector_of(path)
    assert load_detector_of(path, str(gone)) is load_detector(gone)
    assert load_detector_of("attfuse") is load_detector("pillars")


MINE = """
from coopsim.nn.fusion import FeatureFusion
from pathlib import Path
Path(__file__).with_suffix(".ran").touch()

class Own(FeatureFusion):
    def __init__(self, features=64):
        super().__init__()

    def fuse(self, own, own_mask, others, mask, context):
        return own + (others * mask[:, None]).sum(0)
"""


def test_weights_run_code_of_a_fusion_only_if_the_user_names_it(tmp_path: Path) -> None:
    file, path = tmp_path / "own_fusion.py", tmp_path / "own.safetensors"
    file.write_text(MINE)
    net = make_network("cooperative", {**FUSION, "fusion": f"{file}:Own"})
    save_weights(path, net, {"kind": "cooperative", "config": asdict(net.config)})
    file.write_text(f"{MINE}# another text, which is run once more\n")
    file.with_suffix(".ran").unlink()
    with pytest.raises(InvalidValueError, match=r"its fusion is code, '.*own_fusion.py:Own', which runs only if you"):
        load_cooperative(path)
    with pytest.raises(InvalidValueError, match=r"fusion must be that of the training, '.*:Own', got 'else.py:Other'"):
        load_cooperative(path, fusion="else.py:Other")
    assert not file.with_suffix(".ran").exists()
    assert type(load_cooperative(path, fusion=f"{file}:Own").fusion).__name__ == "Own"
    assert file.with_suffix(".ran").exists()


def test_an_unknown_fusion_is_told_with_the_ways_to_name_one() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown fusion 'atfuse' \(or file.py:Class, .* entry points"):
        make_network("cooperative", {**FUSION, "fusion": "atfuse"})
    with pytest.raises(InvalidValueError, match=r"must be a class derived from coopsim.nn.fusion.*FeatureFusion"):
        make_network("cooperative", {**FUSION, "fusion": "pathlib:Path"})


def test_first_weights_depend_on_the_seed_and_leave_the_global_generator(detector: Path) -> None:
    before = torch.random.get_rng_state()
    same, other = make_network("detector", TINY, seed=3), make_network("detector", TINY, seed=4)
    assert torch.equal(torch.random.get_rng_state(), before)
    assert encoder_digest(same) == encoder_digest(load_detector(detector)) != encoder_digest(other)


def test_the_digest_is_of_weights_and_network_not_of_the_rest(detector: Path, tmp_path: Path) -> None:
    net = make_network("detector", TINY, seed=3)
    again, other = tmp_path / "again.safetensors", tmp_path / "other.safetensors"
    save_weights(again, net, {"kind": "detector", "config": asdict(net.config), "recipe": "of another name"})
    with torch.no_grad():
        net.head.state_dict()[next(iter(net.head.state_dict()))].add_(0.01)
    save_weights(other, net, {"kind": "detector", "config": asdict(net.config)})
    assert digest(detector) == digest(again) != digest(other)
    other.replace(again)
    assert digest(again) != digest(detector)  # of what is there now


Change = Callable[[dict[str, Tensor], dict[str, str]], Any]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tensors, texts: tensors.popitem(), "lacks tensors"),
        (lambda tensors, texts: tensors.update(more=torch.zeros(1)), "has unknown tensors: more"),
        (lambda tensors, texts: tensors.update({"head.bias": torch.zeros(2)}), "unknown tensors: head.bias"),
        (lambda tensors, texts: tensors[FIRST].fill_(torch.nan), "encoder.points.weight must be finite"),
        (lambda tensors, texts: tensors.update({FIRST: torch.zeros(3)}), r"must be of shape \(8, 10\)"),
        (lambda tensors, texts: texts.pop("config"), "does not say which network"),
        (lambda tensors, texts: texts.update(classes='["CAR"]'), "other classes"),
        (lambda tensors, texts: texts.update(classes="3"), "other classes"),
        (lambda tensors, texts: texts.update(config="[" * 100_000), "does not say which network"),
        (lambda tensors, texts: texts.update(kind="ball"), "must be weights of the kind 'detector', is 'ball'"),
    ],
)  # fmt: skip
def test_broken_files_are_refused(change: Change, message: str, detector: Path, tmp_path: Path) -> None:
    tensors = {name: value.half() if value.is_floating_point() else value
               for name, value in make_network("detector", TINY, seed=3).state_dict().items()}  # fmt: skip
    texts = read_header(detector)[1]
    change(tensors, texts)
    path = tmp_path / "broken.safetensors"
    write_tensors(path, tensors, texts)
    with pytest.raises(InvalidValueError, match=message):
        load_detector(path)


def test_weights_that_do_not_fit_into_half_precision_are_refused(tmp_path: Path) -> None:
    net = make_network("detector", TINY)
    with torch.no_grad():
        net.encoder.points.weight.fill_(1e9)
    with pytest.raises(InvalidValueError, match=r"encoder.points.weight must be finite and fit"):
        save_weights(tmp_path / "large.safetensors", net, {"kind": "detector", "config": asdict(net.config)})


def test_names_that_are_unknown_say_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="unknown weights 'piller'"):
        load_detector("piller")
    monkeypatch.setattr(weights, "shipped_weights", lambda: ("pillars",))
    with pytest.raises(InvalidValueError, match=r"'gsaf' ship yet: .*coopsim train gsaf --out DIR.*DIR/gsaf"):
        load_cooperative("gsaf")
    with pytest.raises(InvalidValueError, match=r"cannot read missing.safetensors"):
        load_detector("missing.safetensors")


def test_a_path_may_begin_at_home(detector: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(detector.parent))
    assert find_weights(f"~/{detector.name}") == detector


def test_texts_are_json(detector: Path) -> None:
    texts = read_header(detector)[1]
    assert json.loads(texts["config"])["features"] == 8 and texts["kind"] == "detector"


@pytest.mark.parametrize("name", shipped_weights())
def test_weights_that_ship_are_whole_small_and_those_of_their_card(name: str) -> None:
    texts, bytes_ = read_texts(name), find_weights(name).stat().st_size
    if texts["kind"] == "detector":
        load_detector(name)
        assert bytes_ <= 3e6
    elif "pictures" in texts["kind"]:
        load = load_pictures if texts["kind"] == "pictures" else load_points_and_pictures
        load(name, load_detector(texts["detector"]))
        assert bytes_ <= 3e6
    elif texts["kind"] in ("covariance", "point_identity", "picture_identity", "ranking"):
        load_one = {
            "ranking": load_ranking,
            "covariance": load_covariance,
            "point_identity": load_point_identity,
            "picture_identity": load_picture_identity,
        }
        load_one[texts["kind"]](name)
        assert bytes_ <= 1.5e6
    else:
        load_beside = {"cooperative": load_cooperative, "queries": load_queries, "integrated": load_integrated}
        load_beside[texts["kind"]](name, load_detector(texts["detector"]))
        assert bytes_ <= 1.5e6
    said = card(name)
    assert said["weights"][name] == {"digest": digest(name), "bytes": bytes_}
    made_by = "python examples/21_learn_what_to_say.py " if texts["kind"] == "ranking" else f"coopsim train {name} "
    assert said["command"].startswith(made_by)


@pytest.mark.parametrize("size", [{"features": 10**6}, {"channels": [8, 8, 10**6]}, {"layers": [0, 0, 10**6]}])
def test_a_file_cannot_ask_for_a_network_without_measure(tmp_path: Path, size: dict[str, Any]) -> None:
    path = tmp_path / "huge.safetensors"
    save_weights(path, make_network("detector", TINY), {"kind": "detector", "config": TINY | size})
    with pytest.raises(InvalidValueError, match=next(iter(size))):
        load_detector(path)


def test_a_small_file_takes_no_memory_for_the_huge_network_that_it_describes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1,024 channels and 32 layers of three scales are accepted sizes: 3.7 GB of random weights."""
    path = tmp_path / "huge.safetensors"
    size = {"channels": [1024] * 3, "layers": [32] * 3, "features": 1024, "pillar_features": 1024}
    save_weights(path, make_network("detector", TINY), {"kind": "detector", "config": TINY | size})
    made: list[int] = []
    empty = torch.Tensor.uniform_  # first weights of convolutions are drawn by it

    def draw(tensor: Tensor, *given: Any, **named: Any) -> Tensor:
        made.append(0 if tensor.is_meta else tensor.numel())
        return tensor if tensor.is_meta or tensor.numel() > 1e6 else empty(tensor, *given, **named)

    monkeypatch.setattr(torch.Tensor, "uniform_", draw)
    with pytest.raises(InvalidValueError, match="lacks tensors"):
        load_detector(path)
    assert made
    assert max(made) == 0


def test_weights_that_ship_are_read_by_one_network_and_without_torchs_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To compute shapes alone, torch imports its compiler, for a second: only strangers' files need that."""
    on_meta: list[bool] = []

    def make(kind: str, config: dict[str, Any]) -> Any:
        on_meta.append(torch.empty(()).is_meta)
        return make_network(kind, config)

    monkeypatch.setattr("coopsim.learn.weights.make_network", make)
    shipped = find_weights("dmstrack")
    weights._loaded.__wrapped__(shipped, digest(shipped))
    assert on_meta == [False]
    strange = tmp_path / shipped.name
    strange.write_bytes(shipped.read_bytes())
    load_covariance(strange)
    assert on_meta == [False, True, False]
