"""Seeds of episodes."""

from coopsim.envs.vector.courses import Course


def test_every_environment_and_episode_has_its_own_seed() -> None:
    courses = [Course(env, seed, episode=k) for env in range(5) for seed in range(3) for k in range(4)]
    seeds = {course.next_seed for course in courses}
    assert len(seeds) == len(courses)
    assert all(0 <= seed < 2**63 for seed in seeds)
    assert Course(2, 7).advanced.next_seed == Course(2, 7, episode=1).next_seed


def test_an_exact_seed_is_that_of_the_first_episode() -> None:
    course = Course(4, 11, exact=True)
    assert course.next_seed == 11
    assert course.advanced.next_seed == Course(4, 11, episode=1).next_seed
