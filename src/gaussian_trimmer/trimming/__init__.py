"""The way of one trim: its task, its scope, its stages in order, and what follows the decision."""
