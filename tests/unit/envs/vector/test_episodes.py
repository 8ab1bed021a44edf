"""Seeds of episodes."""

from coopsim.envs.vector.environments import Transition
from coopsim.envs.vector.episodes import Episodes

BEGUN = Transition(None, 0.0, False, False, {}, over=False)


def test_every_environment_and_episode_has_its_own_seed() -> None:
    episodes = [Episodes(env, seed, number=k) for env in range(5) for seed in range(3) for k in range(4)]
    seeds = {each.next_seed for each in episodes}
    assert len(seeds) == len(episodes)
    assert all(0 <= seed < 2**63 for seed in seeds)
    assert Episodes(2, 7).after(BEGUN, began=True).next_seed == Episodes(2, 7, number=1).next_seed


def test_an_exact_seed_is_that_of_the_first_episode() -> None:
    first = Episodes(4, 11, exact=True)
    assert first.next_seed == 11
    assert first.after(BEGUN, began=True).next_seed == Episodes(4, 11, number=1).next_seed
