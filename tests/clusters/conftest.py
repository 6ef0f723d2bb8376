"""One loopback Slurm for all tests of this folder that ask for it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from loopback import Loopback, missing


@pytest.fixture(scope="session")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Loopback]:
    """The daemons, running, and their commands in this process's environment."""
    if absent := missing():
        pytest.skip(
            f"{', '.join(absent)} not installed; Debian: apt-get install --no-install-recommends slurm-wlm munge"
        )
    pytest.importorskip(
        "snakemake_executor_plugin_cluster_generic", reason="the extra slurm is not installed"
    )
    cluster = Loopback(tmp_path_factory.mktemp("slurm"))
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith(("SLURM_", "SBATCH_"))]:
            patch.delenv(name)
        for name, value in cluster.environment.items():
            patch.setenv(name, value)
        try:
            cluster.start()
            yield cluster
        finally:
            cluster.stop()
