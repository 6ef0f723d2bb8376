"""Sampling-based planning in the simulator: explorer, teacher and privileged reference."""

from tactile_kit.planning.planner import Planner, PlannerConfig

__all__ = ["Planner", "PlannerConfig"]
