"""What goes wrong with runs, by kind; all are ValueErrors whose message names file, value and what is allowed."""


class RunError(ValueError):
    """A run cannot start or go on."""


class ConfigError(RunError):
    """Settings are unknown, out of range or not those the run was started with."""


class CheckpointError(RunError):
    """No usable checkpoint."""


class LockedError(RunError):
    """Another process works on the run directory."""
