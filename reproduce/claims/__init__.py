"""The 16 claims of the paper's text, each a small function that tests it on our data."""

from reproduce.claims.verdict import NOT_MEASURED, NOT_REPRODUCED, REPRODUCED, Verdict, judge_all

__all__ = ["NOT_MEASURED", "NOT_REPRODUCED", "REPRODUCED", "Verdict", "judge_all"]
