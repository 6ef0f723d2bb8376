"""A replay: one file, which opens from disk and plays."""

from pathlib import Path

import pytest

from reproduce.cli import main
from tactile_kit.errors import ViewError
from tactile_kit.view.frames import Clip
from tactile_kit.view.record import record


def test_a_replay_opens_from_disk_and_plays(clip: Clip, tmp_path: Path, page):
    path = tmp_path / "a.html"
    assert record(clip, path) == path.stat().st_size < 10e6
    page.context.set_offline(True)
    page.goto(path.as_uri())
    page.wait_for_selector("canvas", timeout=60_000)
    clock = page.locator("input[type=hidden]").first  # of the player's slider
    clock.wait_for(state="attached", timeout=60_000)
    pictures, times = set(), set()
    for _ in range(4):
        pictures.add(page.locator("canvas").first.screenshot())
        times.add(float(clock.get_attribute("value")))
    assert len(times) > 1
    assert len(pictures) > 1


def test_a_replay_has_every_frame(clip: Clip, tmp_path: Path):
    import msgspec
    import zstandard

    record(clip, tmp_path / "a.viser")
    packed = (tmp_path / "a.viser").read_bytes()
    inner = zstandard.ZstdDecompressor().decompress(
        packed[8:], max_output_size=int.from_bytes(packed[:8], "little")
    )
    length = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + length])
    assert content["durationSeconds"] == pytest.approx(clip.times[-1] + 2.0)
    moved = {
        time
        for time, message in content["messages"]
        if message["type"] == "SetPositionMessage" and message["name"] == "/view/object"
    }
    assert len(moved) > 2 * (len(clip.frames) - 1)


def test_other_files_are_refused(clip: Clip, tmp_path: Path):
    with pytest.raises(ViewError, match=r"a\.gif.*\.html and \.viser"):
        record(clip, tmp_path / "a.gif")


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (["--objects", "cubee"], "nearest valid name: 'cube'"),
        (["--agent", "nowhere"], "nowhere"),
        (["--extents", "6,6"], "three numbers in cm"),
        (["--terms", "kp"], "NAME=PRESET and NAME=NUMBER"),
        (["--goal", "24"], "0 to 23"),
    ],
)
def test_the_command_names_what_is_wrong(wrong: list[str], text: str, tmp_path: Path, oracle, capsys):
    words = ["view", "--agent", str(oracle.directory), "--record", str(tmp_path / "a.html"), *wrong]
    assert main(words) == 2
    assert text in capsys.readouterr().err
    assert not (tmp_path / "a.html").exists()
