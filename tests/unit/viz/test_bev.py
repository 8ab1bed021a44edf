"""Content and positions of the bird's-eye picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pygame
import pytest
from numpy.typing import NDArray

import coopsim
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Tracks
from coopsim.types.lies import Lie
from coopsim.viz import palette
from coopsim.viz.bev import SPAN_M, BevFrame, BevRenderer
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

WIDTH, HEIGHT = 960, 720
PX_PER_M = WIDTH / SPAN_M
NO_MAP = RoadMap((), (), (), ())
SQUARE = np.array([[10.0, 5.0], [30.0, 5.0], [30.0, 15.0], [10.0, 15.0]])
MAP = RoadMap((SQUARE,), (), (), ())
Picture = NDArray[np.uint8]
LEGEND_PX = (180, 130)
"""Width and height of the corner with the legend."""


def box(x: float, y: float, yaw: float = 0.0) -> Boxes3D:
    return Boxes3D.from_array([[x, y, 0.8, 10.0, 4.0, 1.6, yaw]])


def tracks(track_id: int, boxes: Boxes3D) -> Tracks:
    return Tracks(np.array([track_id]), boxes, np.zeros((1, 2)), np.ones(1), np.zeros(1, dtype=int))


def actors(boxes: Boxes3D) -> Actors:
    count = len(boxes)
    zeros = np.zeros(count, dtype=int)
    return Actors(1 + np.arange(count), boxes, np.zeros((count, 2)), zeros, zeros, np.zeros((count, 3), np.uint8))


def frame(
    truth: Boxes3D | None = None,
    reported: Mapping[str, Tracks] | None = None,
    points: Any = (),
    agent_x: float = 0.0,
    rides_on: int | None = None,
) -> BevFrame:
    body = AgentBody("cav_0", "cav", rides_on, SE3.from_xyz_yaw([agent_x, 0, 0], 0.0), 1.6)
    spots = np.reshape(points, (-1, 3)).astype(float)
    return BevFrame(0, actors(truth or Boxes3D.empty()), {"cav_0": body}, spots, reported or {})


def draw(shown: BevFrame, road_map: RoadMap = NO_MAP, *, all_tracks: bool = False) -> Picture:
    return BevRenderer(road_map, WIDTH, HEIGHT, all_tracks=all_tracks).draw(shown)


def where(picture: Picture, color: palette.RGB) -> Any:
    """x, y in m of all pixels of a colour beside the legend, (N, 2): x to the right, y up, from the middle."""
    same = (picture == color).all(axis=-1)
    same[: LEGEND_PX[1], : LEGEND_PX[0]] = False
    rows, columns = np.nonzero(same)
    return np.column_stack([columns + 0.5 - WIDTH / 2, HEIGHT / 2 - rows - 0.5]) / PX_PER_M


def test_picture_is_rgb_rows_by_columns() -> None:
    picture = draw(frame(box(20, 10)))
    assert picture.shape == (HEIGHT, WIDTH, 3) and picture.dtype == np.uint8
    assert picture.flags.c_contiguous


def test_an_empty_frame_has_no_boxes_but_a_time() -> None:
    picture = draw(BevFrame(1_200_000_000, actors(Boxes3D.empty()), {}, np.zeros((0, 3)), {}))
    assert len(where(picture, palette.TRUTH)) == len(where(picture, palette.AGENT)) == 0
    later = draw(BevFrame(1_300_000_000, actors(Boxes3D.empty()), {}, np.zeros((0, 3)), {}))
    changed = np.argwhere((picture != later).any(axis=-1))
    assert len(changed) and changed.max() < 60, "only the clock in the corner"


@pytest.mark.parametrize(("x", "y"), [(20, 10), (-30, 25), (15, -40), (-50, -20)])
def test_truth_and_tracks_are_drawn_where_they_are(x: float, y: float) -> None:
    as_truth = where(draw(frame(truth=box(x, y))), palette.TRUTH)
    as_track = where(draw(frame(box(x, y), {"cav_0": tracks(3, box(x, y))})), palette.TRACK)
    for spots in (as_truth, as_track):
        np.testing.assert_allclose(spots.min(axis=0), [x - 5, y - 2], atol=2.5 / PX_PER_M)
        np.testing.assert_allclose(spots.max(axis=0), [x + 5, y + 2], atol=2.5 / PX_PER_M)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_a_tick_says_which_way_it_heads(yaw: float) -> None:
    spots = where(draw(frame(truth=box(20, 10, yaw))), palette.TRUTH) - [20, 10]
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    ahead, aside = spots @ heading, spots @ [-heading[1], heading[0]]
    tick = ahead[(np.abs(ahead) < 4) & (np.abs(aside) < 1)]
    assert len(tick) and tick.min() > 1


def test_the_ego_is_filled_another_car_an_outline_and_a_roadside_unit_a_dot() -> None:
    def area_m2(shown: BevFrame) -> float:
        return len(where(draw(shown), palette.AGENT)) / PX_PER_M**2

    name_only = area_m2(frame(rides_on=99))
    whole = area_m2(frame(truth=box(0, 0), rides_on=1)) - name_only
    assert whole > 30
    shown = frame(truth=box(0, 0), rides_on=1)
    first = AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([40, 0, 0], 0.0), 1.6)
    several = replace(shown, agents={"rsu_0": first, **shown.agents})
    assert area_m2(replace(several, ego="cav_0")) > area_m2(several) + whole / 2, "the first one, unless it is named"
    assert 0 < area_m2(frame(rides_on=None)) - name_only < 5


def test_a_track_where_nothing_is_is_thin_and_grey() -> None:
    beside = draw(frame(box(20, 10), {"cav_0": tracks(3, box(20, 13))}))
    assert len(where(beside, palette.TRACK)) and not len(where(beside, palette.FALSE_TRACK))
    false = draw(frame(box(20, 10), {"cav_0": tracks(3, box(-30, 25))}))
    spots = where(false, palette.FALSE_TRACK)
    assert not len(where(false, palette.TRACK)) and len(spots) < len(where(beside, palette.TRACK))
    np.testing.assert_allclose([spots.min(axis=0), spots.max(axis=0)], [[-35, 23], [-25, 27]], atol=2 / PX_PER_M)


def test_the_lower_left_corner_is_free() -> None:
    corner = draw(frame(box(20, 10), {"cav_0": tracks(3, box(20, 10))}))[HEIGHT // 2 :, : WIDTH // 3]
    assert (corner == palette.BACKGROUND).all()


def test_points_are_pixels_and_those_outside_are_left_out() -> None:
    points = [[30.05, -12.05, 1.0], [80.05, 0, 0], [-80.05, 0, 0], [0, 60.05, 0], [0, -60.05, 0], [1e9, 0, 0]]
    (spot,) = where(draw(frame(points=points)), palette.POINT)
    np.testing.assert_allclose(spot, [30.05, -12.05], atol=1 / PX_PER_M)


def test_the_map_lies_beneath() -> None:
    picture = draw(frame(truth=box(20, 10)), MAP)
    lanes = where(picture, palette.MAP["lanes"])
    np.testing.assert_allclose([lanes.min(axis=0), lanes.max(axis=0)], [[10, 5], [30, 15]], atol=2 / PX_PER_M)
    assert len(where(picture, palette.TRUTH))


def test_the_view_goes_with_the_agents_in_steps() -> None:
    here = draw(frame(truth=box(20, 10)))
    np.testing.assert_array_equal(where(here, palette.TRUTH), where(draw(frame(box(20, 10), agent_x=4)), palette.TRUTH))
    np.testing.assert_array_equal(here, draw(frame(truth=box(1020, 10), agent_x=1000)))


def test_only_the_egos_tracks_are_there_unless_all_are_asked_for() -> None:
    both = {"cav_0": tracks(1, box(20, 10)), "rsu_0": tracks(2, box(-30, 10))}
    truth = Boxes3D.concatenate([box(20, 10), box(-30, 10)])
    own, everything = (draw(frame(truth, both), all_tracks=each) for each in (False, True))
    np.testing.assert_array_equal(where(own, palette.TRACK), where(everything, palette.TRACK))
    assert not len(where(own, palette.OTHER_TRACK)) and len(where(everything, palette.OTHER_TRACK))


def test_same_input_same_bits_whatever_was_drawn_before() -> None:
    shown = frame(box(20, 10), {"cav_0": tracks(1, box(21, 10))}, points=[[5, 5, 0]])
    used = BevRenderer(MAP)
    used.draw(frame(box(-20, 0), agent_x=500, points=[[505, 5, 0]]))
    np.testing.assert_array_equal(used.draw(shown), draw(shown, MAP))


def test_the_environment_renders_what_it_scored(make_small: Callable[..., Any]) -> None:
    env = make_small(render_mode="rgb_array")
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    before = env.render()
    for _ in range(3):
        observations, *_ = env.step(policy.act(observations))
    after = env.render()
    np.testing.assert_array_equal(after, env.render())
    np.testing.assert_array_equal(after, BevRenderer(env.road_map).draw(env.bev_frame()))
    assert not np.array_equal(before, after)
    assert len(where(after, palette.TRACK)) and env.bev_frame().about == "cav_0"


class TestWindow:
    """Open invisible windows, by SDL's dummy driver."""

    @pytest.fixture(autouse=True)
    def dummy(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        pygame.display.quit()
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
        yield
        pygame.display.quit()

    @staticmethod
    def window_picture(renderer: BevRenderer) -> Any:
        return pygame.surfarray.array3d(renderer._window.get_surface()).transpose(1, 0, 2)

    def test_it_shows_the_picture_until_closed_and_opens_again(self) -> None:
        renderer = BevRenderer(NO_MAP)
        renderer.close()
        for x in (20, 30):
            renderer.show(frame(box(x, 10)))
            np.testing.assert_array_equal(self.window_picture(renderer), draw(frame(box(x, 10))))
            window = renderer._window
            renderer.close()
            renderer.close()
            with pytest.raises(pygame.error):
                window.get_surface()

    def test_closing_one_leaves_the_other(self) -> None:
        one, other = BevRenderer(NO_MAP), BevRenderer(NO_MAP)
        one.show(frame(box(20, 10)))
        other.show(frame(box(30, 10)))
        one.close()
        other.show(frame(box(40, 10)))
        np.testing.assert_array_equal(self.window_picture(other), draw(frame(box(40, 10))))
        other.close()

    def test_no_screen_is_said_with_the_way_out(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("SDL_VIDEODRIVER", "nonesuch")
        with pytest.raises(InvalidValueError, match=r'"human" cannot open a window.*nonesuch.*"rgb_array"'):
            BevRenderer(NO_MAP).show(frame())

    def test_the_environment_draws_in_every_frame(
        self, make_small: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        shown: list[int] = []
        show = BevRenderer.show

        def spy(renderer: BevRenderer, bev: BevFrame) -> None:
            show(renderer, bev)
            shown.append(bev.time_ns)

        monkeypatch.setattr(BevRenderer, "show", spy)
        env = make_small(render_mode="human", max_cycles=2)
        policy = coopsim.make_policy("no_fusion")
        for _ in range(2):
            observations, _ = env.reset(seed=0)
            policy.reset(env.agent_specs)
            while env.agents:
                observations, *_ = env.step(policy.act(observations))
            assert env.render() is None
            env.close()
            env.close()
        # At reset, then what each step scored, then once more by hand; and all of it again after close.
        assert shown == [0, 0, 100_000_000, 100_000_000] * 2


def test_a_claim_of_a_liar_has_a_colour_of_its_own() -> None:
    lie = Lie(0, "cav_0", "ghost", claimed=box(20, 10))
    assert len(where(draw(replace(frame(), lies=(lie,))), palette.LIE)) > 10
    assert not len(where(draw(frame()), palette.LIE))


def test_bars_at_stop_lines_have_the_colours_of_their_lights() -> None:
    line = np.array([[-30.0, 2.0], [-30.0, -2.0]])  # of those who drive west
    road_map = replace(MAP, stop_lines=(line, line + np.array([20.0, 0.0])), lights="ry")
    renderer = BevRenderer(MAP)
    renderer.draw(frame())
    ground = renderer._ground
    renderer.show_map(road_map)
    picture = renderer.draw(frame())
    assert renderer._ground is ground  # other states of the lights are no other ground
    for letter, x in (("r", -29.6), ("y", -9.6)):
        assert tuple(picture[HEIGHT // 2, round(WIDTH / 2 + x * PX_PER_M)]) == palette.LIGHT[letter]
