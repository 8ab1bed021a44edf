"""Exports of several episodes that are interrupted end in the same bytes, in every format that ships."""

from __future__ import annotations

import pytest

import coopsim
from coopsim.data.export.record_parts import RecordParts

OPTIONS = {"vehicles": 6, "connected_cars": 1, "rsus": 1, "lidar_columns": 64, "cameras": False}


@pytest.mark.parametrize("name", ["kitti", "v2x-seq", "nuscenes(key_frame_s=0.1)"])
def test_the_second_episode_is_interrupted(name, folder_bytes, tmp_path):
    done = 0

    def interrupt(count: int) -> None:
        nonlocal done
        done += count
        if done == 5:  # in the middle of the second episode
            raise KeyboardInterrupt

    def export(folder, progress=None):
        return coopsim.export(name, "crossing", folder, seeds=(0, 1), frames=3, progress=progress, **OPTIONS)

    with pytest.raises(KeyboardInterrupt):
        export(tmp_path / "interrupted", interrupt)
    export(tmp_path / "interrupted")
    export(tmp_path / "whole")
    assert folder_bytes(tmp_path / "interrupted") == folder_bytes(tmp_path / "whole")
    assert list(coopsim.check_export(tmp_path / "interrupted")) == []


def test_lists_are_joined_in_the_order_of_episodes(tmp_path):
    lists = RecordParts(tmp_path, ["few", "none", "many/each"])
    for episode, first in (("b", 0), ("a", 1500)):
        lists.begin_episode(episode)
        lists.append("few", [{"of": episode}])
        for number in range(first, first + 1500):  # more than are held at once
            lists.append("many/each", [{"number": number}])
        lists.end_episode()
    for _ in range(2):  # an end that was interrupted is called again
        lists.join(["b", "a"])
        assert (tmp_path / "few.json").read_text() == '[\n{"of":"b"},\n{"of":"a"}\n]\n'
        assert (tmp_path / "none.json").read_text() == "[\n]\n"
        numbers = [f'{{"number":{number}}}' for number in range(3000)]
        assert (tmp_path / "many/each.json").read_text() == "[\n" + ",\n".join(numbers) + "\n]\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["few.json", "many", "none.json"]
