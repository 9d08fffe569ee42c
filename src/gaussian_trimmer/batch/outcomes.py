"""What became of the items of a batch, and how far it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.storage import Store


@dataclass(frozen=True)
class Outcome:
    """What became of an item."""

    item: Item
    state: Literal["done", "failed", "left"]
    """`left`: it was not tried, since the batch stopped early."""
    message: str = ""
    """Why it failed, in one sentence."""
    fresh: bool = True
    """Whether this run did it; otherwise it was found finished, or failed, from an earlier one."""
    counts: dict[str, int] = field(default_factory=dict)
    """Numbers of Gaussians; see `TrimResult.report`."""
    views: tuple[int, int] = (0, 0)
    """How many views were accepted, of how many."""
    refused: str = ""
    """Why the selection was returned unchanged; empty if it was trimmed."""
    up_confidence: float = 0.0
    seconds: float = 0.0
    """How long the trim took, without reading the scene; 0 if another run did it."""
    fingerprint: str = ""
    """Digest of its inputs and settings."""
    unwritten: bool = False
    """It failed because the output cannot be written, as on a full disk, and may be written by the next run."""


@dataclass(frozen=True)
class Status:
    """How far a batch is."""

    total: int
    done: int
    failed: int
    found: int
    """Those of `done` and `failed` that are from an earlier run."""


def outcome_of(item: Item, told: dict[str, Any], seconds: float = 0.0, *, fresh: bool = False) -> Outcome:
    """The outcome of a finished item, from its `item.json`."""
    accepted, total = told["views"]
    return Outcome(
        item,
        "done",
        fresh=fresh,
        counts=told["counts"],
        views=(accepted, total),
        refused=told["refused"] or "",
        up_confidence=told["up_confidence"],
        seconds=seconds,
        fingerprint=told["fingerprint"],
    )


def earlier_outcome(store: Store, item: Item, fingerprint: str | None = None) -> Outcome | None:
    """What an earlier run left of an item, with this fingerprint if one is given; None if there is nothing."""
    told = store.finished(item.name)
    if told is not None and fingerprint in (None, told["fingerprint"]):
        return outcome_of(item, told)
    record = store.failure(item.name)
    if record is not None and fingerprint in (None, record["fingerprint"]):
        return Outcome(item, "failed", record["message"], fresh=False, fingerprint=record["fingerprint"])
    return None
