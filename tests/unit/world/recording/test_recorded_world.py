"""A recorded world is the world that was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lit_crossing import crossing
from worlds import DT_S, SCENARIOS, make_world, table

import coopsim
from coopsim.envs.simulated.record_episode import recorded_scenario
from coopsim.errors import InvalidValueError, RecordingError, UnknownNameError
from coopsim.world.custom.place import place_from
from coopsim.world.recording.episode_file import Episode, EpisodeHeader, EpisodeWriter
from coopsim.world.recording.recorded_world import PlayedWorld, RecordedWorld
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World


def played(path: Path) -> PlayedWorld:
    episode = Episode(path)
    return PlayedWorld(episode, recorded_scenario(episode))


@pytest.mark.parametrize("name", SCENARIOS)
def test_it_is_the_same_world_to_the_last_bit(tmp_path: Path, name: str) -> None:
    path = coopsim.record(name, tmp_path / "run", seed=3, max_cycles=40, vehicles=12)
    again, world = played(path), make_world(name, 3, vehicles=12)
    assert [part.name for part in again.static] == [part.name for part in world.static]
    for step in range(41):
        assert table(again.actors()).tobytes() == table(world.actors()).tobytes(), step
        assert list(again.agents()) == list(world.agents())
        for agent, body in world.agents().items():
            other = again.agents()[agent]
            assert (other.kind, other.actor_id, other.height_m) == (body.kind, body.actor_id, body.height_m)
            np.testing.assert_array_equal(other.world_SE3_base.rotation, body.world_SE3_base.rotation)
            np.testing.assert_array_equal(other.world_SE3_base.translation, body.world_SE3_base.translation)
        if step < 40:
            again.step(DT_S)
            world.step(DT_S)
    with pytest.raises(RecordingError, match="ends after 40 steps"):
        again.step(DT_S)


def test_a_usual_crossing_takes_little_room(tmp_path: Path) -> None:
    episode = Episode(coopsim.record("crossing", tmp_path / "run", seed=7, max_cycles=50))
    # 38 actors and 4 agents are 6160 bytes a frame as they stand.
    assert episode.size_bytes / episode.frames < 1600


def test_the_header_tells_what_it_takes_to_record_it_again(tmp_path: Path) -> None:
    header = Episode(coopsim.record("highway", tmp_path / "run", seed=5, max_cycles=2, dt_s=0.05, vehicles=9)).header
    assert (header.scenario, header.seed, header.dt_s, header.coopsim) == ("highway", 5, 0.05, coopsim.__version__)
    again = coopsim.record(
        header.scenario, tmp_path / "again", seed=header.seed, max_cycles=2, dt_s=header.dt_s, **header.population
    )
    assert again.read_bytes() == (tmp_path / "run").read_bytes()


def test_numbers_of_numpys_are_recorded_as_plain_ones(tmp_path: Path) -> None:
    numbers = {"seed": np.int64(5), "max_cycles": np.int64(1), "vehicles": np.int64(9), "truck_share": np.float32(0.5)}
    path = coopsim.record("crossing", tmp_path / "run", **numbers)
    plain = coopsim.record("crossing", tmp_path / "plain", seed=5, max_cycles=1, vehicles=9, truck_share=0.5)
    assert path.read_bytes() == plain.read_bytes()


def test_another_time_step_is_refused(tmp_path: Path) -> None:
    world = played(coopsim.record("crossing", tmp_path / "run", max_cycles=1, vehicles=4))
    with pytest.raises(InvalidValueError, match=r"dt_s must be 0.1, as it was recorded, got 0.2"):
        world.step(0.2)


def test_a_recording_with_other_models_is_refused(tmp_path: Path) -> None:
    path = coopsim.record("crossing", tmp_path / "run", max_cycles=1, vehicles=4)
    header = Episode(path).header
    frame = next(iter(Episode(path)))
    models = {**header.models, "spaceship": (40.0, 20.0, 8.0)}
    fields = (header.scenario, header.population, header.seed, header.dt_s, header.agents)
    EpisodeWriter(tmp_path / "other", EpisodeHeader(*fields, models)).append(frame.actors, frame.agents)
    with pytest.raises(RecordingError, match=r"other models than there are: spaceship is missing"):
        PlayedWorld(Episode(tmp_path / "other"), make_scenario("crossing"))


def test_a_recording_among_other_scenery_is_refused(tmp_path: Path) -> None:
    """As of another version, in which a corner was narrower: its traffic would drive through a wall."""
    path = coopsim.record("crossing", tmp_path / "run", max_cycles=1)
    scenario = make_scenario("crossing")
    (*rest, part) = scenario.layout.static
    moved = replace(part, vertices=part.vertices + np.array([0.0, 0.5, 0.0]))
    other = replace(scenario, layout=replace(scenario.layout, static=(*rest, moved)))
    PlayedWorld(Episode(path), scenario)
    with pytest.raises(RecordingError, match=r"recorded \(coopsim .* in another 'crossing' than there is"):
        PlayedWorld(Episode(path), other)


def test_bad_input_is_told_before_anything_is_written(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with pytest.raises(UnknownNameError, match="crossing"):
        coopsim.record("crosing", path)
    with pytest.raises(UnknownNameError, match="vehicles"):
        coopsim.record("crossing", path, vehicle=3)
    with pytest.raises(InvalidValueError, match="seed"):
        coopsim.record("crossing", path, seed=-1)
    with pytest.raises(InvalidValueError, match="max_cycles"):
        coopsim.record("crossing", path, max_cycles=0)
    with pytest.raises(InvalidValueError, match="dt_s"):
        coopsim.record("crossing", path, dt_s=0.0)
    assert not path.exists()


def test_traffic_lights_are_recorded_and_played_as_they_were(tmp_path: Path) -> None:
    scenario = make_scenario(place_from(crossing(lights=True, cut=False), "lit"), vehicles=1, connected_cars=1)
    world = World(scenario, 0)
    recorded = RecordedWorld(world, tmp_path / "run", scenario, 0, 1.0)
    shown = [recorded.map.lights]
    for _ in range(30):
        recorded.step(1.0)
        assert recorded.map.lights == world.map.lights
        shown.append(world.map.lights)
    again = PlayedWorld(Episode(tmp_path / "run"), scenario)
    assert len(set(shown)) > 2 and again.map.lights == shown[0]
    for lights in shown[1:]:
        again.step(1.0)
        assert again.map.lights == lights
