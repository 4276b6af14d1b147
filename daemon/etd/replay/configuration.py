"""The configuration of a record, from the files that it names or from one that is given.

Owns: which files those are. Must not know: engines.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

from etd.files.body_site import load_body_site
from etd.files.configuration import LoadedConfig, digest_of, fake_config, load_config
from etd.files.resources import find
from etd.replay.replay import engine_of


def loaded_of(record: Path, config: Path | None) -> LoadedConfig:
    """Raises: FileError, where a file that the record names is not shipped."""
    if config is not None:
        return load_config(config)
    facts = engine_of(record).facts
    loaded = fake_config(facts.board.name, facts.array.name)
    if facts.body_site == loaded.body_site.name:
        return loaded
    path = find("bodysites", facts.body_site)
    digests = {**loaded.digests, "body_site": digest_of(path)}
    return dataclasses.replace(loaded, body_site=load_body_site(path), digests=digests)
