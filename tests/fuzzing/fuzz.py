"""Feeds a reader of files with what atheris makes up, led by the lines that it reaches: ``fuzz.py NAME SECONDS``.

It begins from whole examples and from what earlier runs have kept in ``corpus/NAME.zip``, and goes on after a finding.
Findings go to ``FOLDER/NAME/`` as they are, with what was wrong beside them; at the end the inputs that reach something
of their own are kept in the corpus again. Needs the extra ``fuzz``.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from pathlib import Path

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
LONGEST = 16_384  # bytes of an input
KEPT = 4096  # bytes of the largest input that is kept
MANY = 200  # inputs kept at most
SLOW = 10.0  # s of processor time that one input may take
INSTRUMENTED = [
    "object_sets",
    "randomization",
    "tactile_kit",
    "reproduce",
    "yaml",
    "json",
    "zipfile",
    "trimesh",
]
TOKENS = ("NaN", "Infinity", ".inf", ".nan", "1e999", "-1", "99999999999999999999", "null", "!!python/name:os",
          "&a", "*a", "<<", "[", "{", "\\x00", "\\xff", "..", "/")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name")
    parser.add_argument("seconds", type=int)
    parser.add_argument("--findings", type=Path, default=Path(tempfile.gettempdir()) / "findings")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)  # the process that atheris ends
    chosen = parser.parse_args()
    if chosen.inside is not None:
        _fuzz(chosen.name, chosen.seconds, chosen.findings, chosen.inside)
        return
    with tempfile.TemporaryDirectory() as scratch:
        inputs = Path(scratch) / "inputs"
        inputs.mkdir()
        for path, data in kept(chosen.name):
            (inputs / path).write_bytes(data)
        command = [
            sys.executable,
            __file__,
            chosen.name,
            str(chosen.seconds),
            "--findings",
            str(chosen.findings),
        ]
        subprocess.run([*command, "--inside", scratch], check=False)
        _keep(chosen.name, inputs)


def kept(name: str) -> list[tuple[str, bytes]]:
    """What the corpus holds for a reader: names and inputs."""
    path = CORPUS / f"{name}.zip"
    if not path.is_file():
        return []
    with zipfile.ZipFile(path) as archive:
        return [(member, archive.read(member)) for member in sorted(archive.namelist())]


def _keep(name: str, inputs: Path) -> None:
    """The smallest inputs of those that atheris found to reach something of their own; the same give the same bytes."""
    small = {path.read_bytes() for path in inputs.iterdir() if path.stat().st_size <= KEPT}
    chosen = sorted(
        {data for _, data in kept(name)} | set(sorted(small, key=lambda data: (len(data), data))[:MANY])
    )
    CORPUS.mkdir(exist_ok=True)
    with zipfile.ZipFile(CORPUS / f"{name}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for data in chosen:
            info = zipfile.ZipInfo(hashlib.sha256(data).hexdigest()[:16], (1980, 1, 1, 0, 0, 0))
            archive.writestr(info, data, zipfile.ZIP_DEFLATED)


def _fuzz(name: str, seconds: int, findings: Path, scratch: Path) -> None:
    import atheris

    sys.path.insert(0, str(HERE))
    with atheris.instrument_imports(include=INSTRUMENTED):
        from readers import READERS, complaint
    words = set(TOKENS)
    for number, data in enumerate(READERS[name].examples()):
        (scratch / "inputs" / f"example-{number}").write_bytes(data[:LONGEST])
        words |= {word.decode() for word in re.findall(rb"[A-Za-z_]{3,24}", data)}
    (scratch / "words").write_text("".join(f'"{word}"\n' for word in sorted(words)))
    place, seen = scratch / "place", set()

    def once(data: bytes) -> None:
        place.mkdir()
        started = time.process_time()
        try:
            said = complaint(name, data, place)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a reader must not end the program either
            said = f"{type(error).__name__}: {traceback.format_exc()[-500:]}"
        spent = time.process_time() - started
        if spent > SLOW:
            said = said or f"takes {spent:.0f} s"
        shutil.rmtree(place)
        kind = re.sub(r"[\d'\"].*", "", said.replace(str(place), ""))[:80]
        if said and kind not in seen:
            seen.add(kind)
            (findings / name).mkdir(parents=True, exist_ok=True)
            file = findings / name / hashlib.sha256(data).hexdigest()[:16]
            file.write_bytes(data)
            file.with_suffix(".txt").write_text(said + "\n")
            print(f"{name}: {said}", flush=True)

    limits = [f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-timeout=60", "-rss_limit_mb=4096"]
    limits.append("-print_final_stats=1")
    arguments = [sys.argv[0], str(scratch / "inputs"), f"-dict={scratch / 'words'}", *limits]
    atheris.Setup([*arguments, f"-artifact_prefix={scratch}/"], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
