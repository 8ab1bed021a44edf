"""Nothing that users plug in can have the episode's seed from what it is given, nor tell truth by place in a list."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.stats import kendalltau, rankdata

import coopsim
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.budget import SELECTIONS, ByScore
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.detection.detector import Detector, SensorNeeds
from coopsim.envs.wrappers.driving_wrapper import Driving
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.rng import derived_seed, stream
from coopsim.types import AgentSpec, Detections, Observation, SensorView, Tracks
from coopsim.wire.observation_format import ObservationFormat

SEED = 0x1A2B3C4D5E6F
SMALL: dict[str, Any] = {"vehicles": 8, "lidar": None}
NEAR_M = 2.0


def names_seed(given: object) -> bool:
    """Return whether the episode's seed stands in an integer, or in the bytes of a generator."""
    if isinstance(given, int):
        return given == SEED
    raw = pickle.dumps(given)
    return SEED.to_bytes(6, "little") in raw or str(SEED).encode() in raw


def test_a_stream_hides_its_seed_and_keeps_its_bits() -> None:
    made = stream(SEED, "lidar", "cav_0")
    assert not names_seed(made) and names_seed(np.random.default_rng(SEED)), "the check itself finds a seed"
    assert stream(7, "lidar", "cav_0").random() == 0.0682696256777664, "sweeps of published results rest on it"
    first, second = stream(SEED, "policy", "cav_0").spawn(1), stream(SEED, "policy", "cav_1").spawn(1)
    assert first[0].random() != second[0].random()


def test_derived_seeds_differ_by_seed_purpose_and_owner() -> None:
    made = [derived_seed(*key) for key in ((1, "a"), (2, "a"), (1, "b"), (1, "a", "b"), (1, "ab"))]
    assert len(set(made)) == 5 and all(0 <= each < 2**63 for each in made)


class Listener:
    """Notes all that plug-ins are given that could come from the seed."""

    def __init__(self) -> None:
        self.given: dict[str, list[object]] = {}

    def __deepcopy__(self, memo: object) -> Listener:
        return self  # environments copy the policies that they are given

    def note(self, kind: str, *values: object) -> None:
        self.given.setdefault(kind, []).extend(values)


class NosyUplink(ShareDetections):
    """An uplink that notes its stream."""

    def __init__(self, listener: Listener) -> None:
        super().__init__("detections")
        self._listener = listener

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._listener.note("uplink", rng)


class NosyDetector(Detector):
    """A detector that notes its seed and its stream."""

    needs = SensorNeeds()

    def __init__(self, listener: Listener) -> None:
        self._listener = listener

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> NosyDetector:
        self._listener.note("detector's seed", seed)
        return self

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        self._listener.note("detector", rng)
        return Detections.empty()


class NosyPolicy(coopsim.Policy):
    """A policy that notes its seed and its streams."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        self._listener.note("policy's seed", seed)
        super().reset(agent_specs, seed)

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._listener.note("policy", rng)

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        self._listener.note("factory of uplinks", rng)
        return NosyUplink(self._listener)

    def track(self, agent: str, observation: Observation) -> Tracks:
        return Tracks.empty()


def test_no_kind_of_plug_in_is_given_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Embedders, codecs, metrics and rewards are given neither a seed nor a stream."""
    listener = Listener()

    def nosy_selection(rng: np.random.Generator) -> ByScore:
        listener.note("selection", rng)
        return ByScore(rng)

    monkeypatch.setitem(SELECTIONS._entries, "nosy", nosy_selection)
    options = {**SMALL, "detector": NosyDetector(listener), "budget_bytes": 500, "selection": "nosy", "max_cycles": 2}
    coopsim.evaluate(NosyPolicy(listener), "crossing", seed=SEED, **options)
    kinds = {"policy's seed", "policy", "factory of uplinks", "uplink", "selection", "detector's seed", "detector"}
    assert listener.given.keys() == kinds
    for kind, values in listener.given.items():
        assert values and not any(names_seed(value) for value in values), f"{kind} is given the seed"


def test_policies_inside_environments_of_learners_are_not_given_the_seed() -> None:
    listener = Listener()
    options: dict[str, Any] = {**SMALL, "control": "policy", "max_cycles": 2}
    nosy = NosyPolicy(listener)
    coopsim.single_env("crossing", others=nosy, tracker=nosy, **options).reset(seed=SEED)
    Driving(coopsim.parallel_env("crossing", uplink="detections", **options), nosy).reset(seed=SEED)
    assert len(listener.given["policy's seed"]) > 1
    assert not any(names_seed(value) for values in listener.given.values() for value in values)


class Twin(coopsim.Policy):
    """A policy that makes a second environment by its seed, and reports the truth of that."""

    needs = coopsim.Needs(uplink="none")

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        super().reset(agent_specs, seed)
        self._twin = coopsim.parallel_env(
            "crossing", expose_ground_truth=True, detector="none", uplink="none", max_cycles=99, **SMALL
        )
        _, self._infos = self._twin.reset(seed=seed)

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        made = {agent: self.track(agent, each) for agent, each in observations.items()}
        nothing = coopsim.make_policy("no_fusion")
        nothing.reset(self._twin.agent_specs)
        *_, self._infos = self._twin.step(nothing.act(self._twin.episode.observations))
        return made

    def track(self, agent: str, observation: Observation) -> Tracks:
        truth = self._infos[agent]["ground_truth"]
        boxes = Boxes3D.from_array(truth["box"])
        return Tracks(truth["id"], boxes, truth["velocity"], np.ones(len(boxes)), truth["label"])


def test_a_twin_environment_by_the_given_seed_is_another_one() -> None:
    evaluation = coopsim.evaluate(Twin(), "crossing", seed=3, max_cycles=15, **SMALL)
    assert evaluation.score["HOTA"] < 30.0


def frames(detector: str, **options: Any) -> Iterator[tuple[dict[str, Any], dict[str, Any], Any]]:
    """Yield observations, infos and the environment of each frame."""
    env = coopsim.parallel_env("crossing", detector=detector, expose_ground_truth=True, **(SMALL | options))
    policy = coopsim.make_policy("no_fusion")
    for seed in (0, 1):
        observations, infos = env.reset(seed=seed)
        policy.reset(env.agent_specs)
        while env.agents:
            yield observations, infos, env
            observations, *_, infos = env.step(policy.act(observations))


def boxes_of(detector: str) -> np.ndarray[Any, Any]:
    """Return (N, 4) of all detections: false or not, place in its list in [0, 1], underside m, score."""
    rows: list[tuple[float, ...]] = []
    for observations, infos, _ in frames(detector, vehicles=30, max_cycles=40):
        for agent, observation in observations.items():
            box, truth = observation["detections"]["box"], infos[agent]["ground_truth"]["box"]
            far = np.linalg.norm(box[:, None, :2] - truth[None, :, :2], axis=2).min(axis=1, initial=np.inf) > NEAR_M
            place = np.linspace(0.0, 1.0, len(box)) if len(box) > 1 else np.full(len(box), 0.5)
            score = observation["detections"]["score"][:, 0]
            rows += zip(far, place, box[:, 2] - box[:, 5] / 2, score, strict=True)
    return np.array(rows, dtype=float)


def separation(value: np.ndarray[Any, Any], false: np.ndarray[Any, Any]) -> float:
    """Return the area under the ROC curve of telling false boxes by a value; 0.5: it tells nothing."""
    rank, count = rankdata(value), int(false.sum())
    return float((rank[false].sum() - count * (count + 1) / 2) / (count * (len(false) - count)))


@pytest.mark.parametrize(("detector", "told"), [("simulated", 0.05), ("pointpillars_v2v4real", 0.08)])
def test_neither_place_nor_underside_tells_false_boxes(detector: str, told: float) -> None:
    """False boxes of the real detector stand farther off the ground than objects; so do the fitted one's, a little."""
    rows = boxes_of(detector)
    false = rows[:, 0] > 0
    assert false.sum() > 150 and (~false).sum() > 2000
    assert abs(separation(rows[:, 1], false) - 0.5) < 0.05, "place in the list"
    assert abs(separation(np.abs(rows[:, 2]), false) - 0.5) < told, "distance of the underside from the ground"
    assert abs(separation(rows[:, 2], false) - 0.5) < 0.05, "height of the underside"
    assert separation(rows[:, 3], false) < 0.3, "scores are to tell, or the classes are mixed up here"


@pytest.mark.parametrize("detector", ["simulated", "pointpillars_v2v4real"])
def test_lists_share_no_order_with_the_truth_other_agents_or_other_frames(detector: str) -> None:
    with_truth, between_agents, between_frames = [], [], []
    before: dict[str, dict[int, int]] = {}
    for observations, infos, _ in frames(detector, vehicles=30, max_cycles=80):
        places = {agent: places_of_objects(observations[agent], infos[agent]) for agent in observations}
        with_truth += [order_shared({actor: actor for actor in each}, each) for each in places.values()]
        between_agents += [order_shared(places["cav_0"], each) for name, each in places.items() if name != "cav_0"]
        between_frames += [order_shared(before.get(agent, {}), each) for agent, each in places.items()]
        before = places
    for shared in (with_truth, between_agents, between_frames):
        known = [value for value in shared if value is not None]
        assert len(known) > 100 and abs(np.mean(known)) < 0.1


def places_of_objects(observation: Mapping[str, Any], info: Mapping[str, Any]) -> dict[int, int]:
    """Return the place in the list of each object that is detected, by its id."""
    truth = info["ground_truth"]
    apart = np.linalg.norm(observation["detections"]["box"][:, None, :2] - truth["box"][None, :, :2], axis=2)
    return {int(truth["id"][row.argmin()]): place for place, row in enumerate(apart) if row.min() < NEAR_M}


def order_shared(first: Mapping[int, int], second: Mapping[int, int]) -> float | None:
    """Return Kendall's tau of the objects' order in two lists; None with less than three in common."""
    both = sorted(first.keys() & second.keys())
    if len(both) < 3:
        return None
    return float(kendalltau([first[each] for each in both], [second[each] for each in both]).statistic)


@pytest.mark.parametrize("codec", ["detections", "compact", "cpm"])
def test_messages_do_not_keep_the_order_of_the_truth_either(codec: str) -> None:
    with_truth = []
    for observations, infos, env in frames("simulated", vehicles=20, max_cycles=15, codec=codec):
        reader = ObservationFormat.to_unpack(env.agent_specs)
        heard = {message for each in reader.unpack_all(observations).values() for message in each.inbox}
        for message in sorted(heard, key=lambda message: message.sender):
            box = decode_detections(message).boxes.array
            places = places_of_objects({"detections": {"box": box}}, infos[message.sender])
            with_truth.append(order_shared({actor: actor for actor in places}, places))
    known = [value for value in with_truth if value is not None]
    assert len(known) > 50 and abs(np.mean(known)) < 0.1
