"""What an agent does, to be looked at: one scene of recorded frames, drawn in the browser, in replays and in films."""
