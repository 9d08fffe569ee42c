"""The commands of `gaussian-trimmer`: a dataclass each, whose fields are the options and whose `run` does the work."""
