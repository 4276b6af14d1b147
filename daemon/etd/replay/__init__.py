"""A record played once more: the same engine on a fake board that measures what was measured."""
