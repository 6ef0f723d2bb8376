"""The subcommands of ``object-sets``, one file each; nothing heavy is imported before a command runs."""
