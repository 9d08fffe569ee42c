"""A batch: a map over the rows of a manifest, on the processors of this machine or on a Ray cluster."""
