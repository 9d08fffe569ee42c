"""CLIP-IQA with a tiny CLIP of random weights: what reaches the model and what comes back, not how well it judges."""

import json
import os
import string
import sys

import numpy as np
import pytest
from command_line import run, save_ball

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.metrics import PAIRS, ClipScorer

os.environ.setdefault("HF_HUB_OFFLINE", "1")
SIDE = 30


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A folder with a CLIP of some thousand parameters and a tokenizer that spells."""
    import torch
    import transformers

    folder = tmp_path_factory.mktemp("models") / "tiny-clip"
    letters = [*string.ascii_lowercase, "."]
    tokens = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    tokenizer = transformers.CLIPTokenizer(vocab={token: i for i, token in enumerate(tokens)}, merges=[])
    tokenizer.save_pretrained(folder)
    layers = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    ends = {"bos_token_id": len(tokens) - 2, "eos_token_id": len(tokens) - 1}
    text = {"vocab_size": len(tokens), "max_position_embeddings": 77, **layers, **ends}
    vision = {"image_size": SIDE, "patch_size": 10, **layers}
    torch.manual_seed(0)
    config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=8)
    model = transformers.CLIPModel(config)
    with torch.no_grad():
        for weights in model.parameters():
            if weights.ndim > 1:
                weights.normal_(0, 0.3)
    model.save_pretrained(folder)
    return folder


def ring(size=120):
    """A red disc with a soft edge over black."""
    y, x = np.mgrid[:size, :size] - size / 2
    alpha = np.clip(35 - np.hypot(x, y), 0, 1).astype(np.float32)
    return np.float32([0.8, 0.1, 0.1]) * alpha[..., None], alpha


@pytest.mark.needs("torch", "transformers")
def test_scores_are_probabilities_that_follow_the_picture(clip, monkeypatch):
    scorer, (rgb, alpha) = ClipScorer(str(clip)), ring()
    scores = scorer.score(rgb, alpha, 0.5)
    assert list(scores) == list(PAIRS) and all(0 < value < 100 for value in scores.values())
    assert scorer.score(rgb, alpha, 0.5) == scores
    blue = scorer.score(rgb[..., ::-1], alpha, 0.5)
    assert all(abs(blue[name] - scores[name]) > 1e-3 for name in scores)
    assert "tiny-clip" in scorer.describe()
    blank = np.zeros((50, 50), np.float32)
    assert scorer.score(np.zeros((50, 50, 3), np.float32), blank, 0.5) == {}  # the object is out of the picture
    seen = []
    monkeypatch.setattr(scorer, "_probabilities", lambda picture: seen.append(picture) or np.arange(3.0) / 100)
    assert scorer.score(rgb, alpha, 0.5) == dict(zip(PAIRS, (0.0, 1.0, 2.0), strict=True))
    assert seen[0].shape == (120, 120, 3) and seen[0][0, 0].tolist() == [0, 0, 0]  # all of it, over black


@pytest.mark.needs("torch", "transformers")
def test_prompts_have_the_published_form(clip, monkeypatch):
    import transformers

    given = []
    tokenizer = transformers.CLIPTokenizer
    monkeypatch.setattr(
        tokenizer, "__call__", lambda self, prompts, **named: given.extend(prompts) or {"input_ids": None}
    )
    ClipScorer(str(clip))
    assert given[:2] == ["Clear boundary.", "Unclear boundary."]
    assert given[-1] == "Mutilated object." and len(given) == 6


@pytest.mark.needs("torch", "transformers")
def test_on_the_command_line(clip, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_ball(tmp_path)
    common = ["scene.ply", "rough.npy", "--masks", "masks", "--cameras", "cameras.json", "--clip", clip]
    assert run("evaluate", *common, "--json") == 0
    table = json.loads(capsys.readouterr().out)
    assert 0 < table["rows"][-1]["CLIP-IQA clear boundary (%)"] < 100
    assert any("tiny-clip" in note for note in table["notes"])


@pytest.mark.needs("torch", "transformers")
def test_nvos_has_a_table_of_looks(clip, tmp_path, capsys):
    import dataset_layouts

    dataset_layouts.save_nvos(tmp_path / "nvos", tmp_path / "SAGD")
    arguments = ["--predictions", tmp_path / "SAGD", "--tasks", "fern", "--clip", clip, "--format", "csv"]
    assert run("evaluate", "nvos", tmp_path / "nvos", *arguments, "--set", "plan.size=160") == 0
    printed = capsys.readouterr().out
    assert "method,rule,CLIP-IQA clear boundary (%)," in printed and "SAGD,CLIP-IQA," in printed


@pytest.mark.needs("torch", "transformers")
def test_what_cannot_be_loaded_is_named(clip, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="Cannot load the CLIP model"):
        ClipScorer(str(tmp_path))
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"pip install '\.\[eval\]'"):
        ClipScorer("any")
