"""The paper for an ethics board: what this configuration can do to a person, in numbers.

Owns: the figures, and their form. Must not know: a running daemon, boards, people's names.
"""
