"""No line of the code base can run code from a file: no pickles, no YAML tags, no eval, no shell."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("object_sets", "randomization", "reproduce", "tactile_kit", "benchmarks")
UNPICKLERS = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
LOADERS = {
    "torch.load": "unpickles",
    "torch.jit.load": "runs code",
    "torch.hub.load": "runs code",
    "yaml.load": "may follow tags",
    "yaml.load_all": "may follow tags",
    "yaml.full_load": "follows tags",
    "yaml.unsafe_load": "follows tags",
    "os.system": "is a shell",
    "os.popen": "is a shell",
    "eval": "runs code",
    "exec": "runs code",
}
# SB3's own format holds pickles: its learners neither load nor save here.
LEARNERS = {"PPO", "SAC", "stable_baselines3.PPO", "stable_baselines3.SAC", "BaseAlgorithm", "VecNormalize"}


def findings(source: str) -> Iterator[str]:
    """What in ``source`` could run code from a file, with its line."""
    for node in ast.walk(ast.parse(source)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
            for alias in node.names:
                if f"{node.module}.{alias.name}" in LOADERS:
                    yield f"{node.lineno}: imports {node.module}.{alias.name}"
        for name in names:
            if name.split(".")[0] in UNPICKLERS:
                yield f"{node.lineno}: imports {name}"
        if isinstance(node, ast.Call):
            yield from (f"{node.lineno}: {what}" for what in _call(node))


def _call(node: ast.Call) -> Iterator[str]:
    name = ast.unparse(node.func)
    words = {word.arg: word.value for word in node.keywords}
    if name in LOADERS:
        yield f"{name} {LOADERS[name]}"
    owner, _, method = name.rpartition(".")
    if owner in LEARNERS and method in ("load", "save"):
        yield f"{name} is a zip of pickles"
    if owner in ("np", "numpy") and method == "load" and "allow_pickle" not in words:
        yield f"{name} without allow_pickle=False"
    allowed = words.get("allow_pickle")
    if allowed is not None and not (isinstance(allowed, ast.Constant) and allowed.value is False):
        yield f"{name} with allow_pickle={ast.unparse(allowed)}"
    if "shell" in words and ast.unparse(words["shell"]) != "False":
        yield f"{name} with a shell"


def test_the_code_base_runs_no_code_from_files() -> None:
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    assert len(files) > 100
    found = [
        f"{file.relative_to(ROOT)}:{what}"
        for file in files
        for what in findings(file.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from joblib import load",
        "import marshal as m",
        "torch.load('x', weights_only=True)",
        "from torch import load",
        "np.load('x')",
        "numpy.load('x', allow_pickle=True)",
        "np.load('x', allow_pickle=flag)",
        "np.savez('x', allow_pickle=True, a=a)",
        "yaml.load(text, Loader=yaml.SafeLoader)",
        "yaml.unsafe_load(text)",
        "model = PPO.load('x')",
        "stable_baselines3.SAC.load('x')",
        "eval(text)",
        "subprocess.run('ls', shell=True)",
        "os.system('ls')",
    ],
)
def test_each_way_would_be_found(line: str) -> None:
    assert list(findings(f"def f():\n    {line}\n"))


@pytest.mark.parametrize(
    "line",
    [
        "np.load('x', allow_pickle=False)",
        "yaml.safe_load(text)",
        "model.eval()",
        "run(['ls'])",
        "json.load(f)",
    ],
)
def test_harmless_lines_pass(line: str) -> None:
    assert not list(findings(line))
