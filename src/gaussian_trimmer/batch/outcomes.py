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
    """Why the coarse selection was returned unchanged; empty if it was trimmed."""
    up_confidence: float = 0.0
    seconds: float = 0.0
    """How long the trim took, without reading the scene; 0 if another run did it."""
    fingerprint: str = ""
    """Digest of its inputs and settings."""
    cause: Literal["item", "output", "worker", "busy"] = "item"
    """What made it fail: itself, an output that cannot be written, a worker that died, or another run that is writing
    it; the last two are tried again."""


@dataclass(frozen=True)
class Status:
    """How far a batch is."""

    total: int
    done: int
    failed: int
    found: int
    """Those of `done` and `failed` that are from an earlier run."""
    running: dict[int, tuple[str, float]]
    """What each worker is at: a name, and for how many seconds."""


def outcome_of(item: Item, told: dict[str, Any], seconds: float = 0.0, *, fresh: bool = False) -> Outcome:
    """The outcome of a finished item, from its `item.json`."""
    accepted, total = told.get("views") or (0, 0)
    return Outcome(
        item,
        "done",
        fresh=fresh,
        counts=dict(told.get("counts") or {}),
        views=(int(accepted), int(total)),
        refused=str(told.get("refused") or ""),
        up_confidence=float(told.get("up_confidence") or 0.0),
        seconds=seconds,
        fingerprint=str(told.get("fingerprint") or ""),
    )


def earlier_outcome(store: Store, item: Item, fingerprint: str | None = None) -> Outcome | None:
    """What an earlier run left of an item, with this fingerprint if one is given; None if there is nothing."""
    told = store.finished(item.name)
    if told is not None and fingerprint in (None, told.get("fingerprint")):
        return outcome_of(item, told)
    record = store.failure(item.name)
    if record is not None and fingerprint in (None, record.get("fingerprint")):
        message = str(record.get("message", ""))
        return Outcome(item, "failed", message, fresh=False, fingerprint=str(record.get("fingerprint", "")))
    return None
