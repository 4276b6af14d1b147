"""The process that drives the board: two loops, a state machine, and the rules they obey."""
