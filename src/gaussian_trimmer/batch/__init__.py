"""Many objects of many scenes: on the processors of this machine, on a Ray cluster, or in shards.

import gaussian_trimmer as gt

items = gt.batch.read_manifest("manifest.csv")
outcomes = gt.batch.run(items, "out", on_result=lambda outcome: print(outcome.item.name, outcome.state))
"""

from __future__ import annotations

from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.manifest import read_manifest
from gaussian_trimmer.batch.running import BatchOptions, Status, run
from gaussian_trimmer.batch.store import Outcome

__all__ = ["BatchOptions", "Item", "Outcome", "Status", "read_manifest", "run"]
