"""Sampling-based planning in the simulator: the privileged reference of Table I."""

from tactile_kit.planning.planner import Planner, PlannerConfig

__all__ = ["Planner", "PlannerConfig"]
