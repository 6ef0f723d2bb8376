"""Makes the estimator tests' helper module importable: importlib import mode adds no paths."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "estimator"))
