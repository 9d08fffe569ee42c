"""FlashSplat's assignment, row by row and in chunks."""

import numpy as np
import pytest

from gaussian_trimmer.selection_files import label_assignment
from gaussian_trimmer.selection_files.label_assignment import assign_labels


@pytest.mark.parametrize(
    ("row", "gamma", "label"),
    [
        ([2.0, 2.0], 0.0, 0),  # a tie is background
        ([0.0, 5.0, 5.0], 0.0, 1),  # a tie of two objects goes to the lower number
        ([3.0, 4.0], 0.19, 1),  # 0.6 + gamma against 0.8
        ([3.0, 4.0], 0.21, 0),
        ([300.0, 400.0], 0.19, 1),  # the same however much it is seen
        ([0.0, 1e-30], 0.9, 1),
        ([0.0, 0.0], -1.0, 0),
    ],
)
def test_assignment_of_one_row(row, gamma, label):
    assert assign_labels(np.array([row]), gamma).tolist() == [label]


def test_chunks_and_the_order_in_memory_change_nothing(monkeypatch):
    weights = np.random.default_rng(0).random((100, 5)).astype(np.float32)
    labels = assign_labels(weights, 0.1)
    assert len(set(labels.tolist())) > 2
    monkeypatch.setattr(label_assignment, "_ROWS_PER_CHUNK", 7)
    np.testing.assert_array_equal(assign_labels(weights, 0.1), labels)
    np.testing.assert_array_equal(assign_labels(np.asfortranarray(weights), 0.1), labels)
