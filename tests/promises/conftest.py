"""Makes the cases importable (importlib's import mode adds no paths); prepared grasps go to a cache of their own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILE_KIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
