"""What goes wrong with agents on disk."""


class AgentError(ValueError):
    """An agent directory cannot be used; the message names file, value and what is allowed."""
