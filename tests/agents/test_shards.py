"""Work in parts: each row once, results in order, one torch thread in each part, errors passed on."""

from __future__ import annotations

import threading

import pytest
import torch

from tactile_kit.agents.shards import Shards


@pytest.mark.parametrize(("count", "size"), [(1, 5), (2, 5), (3, 2), (4, 64)])
def test_every_row_is_in_one_part_and_results_come_in_order(count: int, size: int) -> None:
    found = Shards(count).run(lambda part: list(range(size))[part], size)
    assert [row for part in found for row in part] == list(range(size)) and len(found) == min(count, size)
    assert max(map(len, found)) - min(map(len, found)) <= 1


def test_parts_run_side_by_side_with_one_torch_thread_each() -> None:
    before, met = torch.get_num_threads(), threading.Barrier(2, timeout=10)
    torch.set_num_threads(2)
    try:

        def work(part: slice) -> int:
            met.wait()  # breaks where one part waits for the other
            return torch.get_num_threads()

        assert Shards(2).run(work, 8) == [1, 1] and torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_an_error_in_a_part_is_the_callers() -> None:
    with pytest.raises(ZeroDivisionError):
        Shards(2).run(lambda part: 1 // part.start, 4)


def test_no_threads_are_refused() -> None:
    with pytest.raises(ValueError, match="threads = 0: allowed are 1 and more"):
        Shards(0)
