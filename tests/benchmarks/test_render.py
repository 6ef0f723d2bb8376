"""The pages show what the records say; the section clocks count nothing twice."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import pytest
import render
from record import RESULTS, ROOT, Sections
from tables_speed import bps_goals, vector


@pytest.mark.parametrize("page", render.PAGES)
def test_pages_are_rendered_from_the_records(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert render.BLOCK.search(text)
    assert render.rendered(text) == text


def test_every_block_has_a_place() -> None:
    text = "".join((ROOT / page).read_text(encoding="utf-8") for page in render.PAGES)
    assert sorted(found[2] for found in render.BLOCK.finditer(text)) == sorted(render.BLOCKS)


def test_an_unknown_block_is_an_error() -> None:
    with pytest.raises(SystemExit, match="block 'sped'"):
        render.rendered("<!-- bench sped: x -->\n<!-- /bench -->\n")


def test_records_name_machine_versions_date_and_revision() -> None:
    records = sorted(RESULTS.glob("*.json"))
    assert records
    for path in records:
        machine = json.loads(path.read_text(encoding="utf-8"))["machine"]
        assert {"processor", "cores", "load", "versions", "date", "revision"} <= set(machine), path


def test_a_missing_peer_and_a_missed_goal_show() -> None:
    rows = [
        {"triangles": t, "batch": b, "ours": 1.0, "ours backward": 1.0, "warp": 10.0, "libigl": 1.5}
        for t in (12, 60)
        for b in (1, 1024)
    ]
    text = "\n".join(bps_goals({"rows": rows}))
    assert "| NVIDIA Warp on the CPU | 10 (6) | 10 (6) |" in text
    assert "| NVIDIA Warp, backward | missing | missing |" in text
    assert "Not reached: libigl AABB, no inside test at 12 triangles" in text


def test_a_busy_machine_gets_no_verdict_on_workers() -> None:
    record = json.loads((RESULTS / "vector.json").read_text(encoding="utf-8"))
    record["workers"] |= {"two_over_one": 1.6, "ceiling": 1.62, "share_of_ceiling": 0.99}
    text = "\n".join(vector(record))
    assert "1.60 | 1.9: **not reached**" in text and "0.99 | 0.95: reached" in text
    record["workers"] |= {"two_over_one": 1.9, "ceiling": 1.1, "share_of_ceiling": 1.7}
    text = "\n".join(vector(record))
    assert text.count("no verdict") == 2 and "0.95: reached" not in text


def test_sections_leave_inner_time_to_the_inner_section() -> None:
    sections = Sections(time.perf_counter)
    inner = sections.wrap("inner", lambda: time.sleep(0.02))
    outer = sections.wrap("outer", lambda: (inner(), inner()))
    outer()
    assert sections.calls == {"inner": 2, "outer": 1}
    assert sections.seconds["inner"] >= 0.04 > 0.02 > sections.seconds["outer"]


@pytest.mark.slow
def test_a_quick_peerless_run_works_and_writes_nothing_in_the_repository() -> None:
    before = {path: path.read_bytes() for path in RESULTS.glob("*.json")}
    script = ROOT / "benchmarks" / "bench_bps.py"
    command = [sys.executable, str(script), "--quick", "--batches", "32", "--triangles", "12"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert run.returncode == 0, run.stderr
    record = json.loads(run.stdout[run.stdout.index("{\n") :])
    assert record["rows"][0]["ours"] > 0 and record["exactness"]["ours"]["sign_errors"] == 0
    assert {path: path.read_bytes() for path in RESULTS.glob("*.json")} == before
