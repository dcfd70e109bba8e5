"""Layout of open_clip: its settings and tensors, told as `transformers` tells those of a CLIP.

Ilharco et al., "OpenCLIP", 2021. Its tensors have the names that the authors of CLIP gave them.
"""

import re
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from frida_painter.errors import WeightsError
from frida_painter.weights.hub_folder import OPEN_CLIP

_TOWERS = (  # part of the name, name in the layout of transformers
    (r"visual\.class_embedding", "vision_model.embeddings.class_embedding"),
    (r"visual\.positional_embedding", "vision_model.embeddings.position_embedding.weight"),
    (r"visual\.conv1\.", "vision_model.embeddings.patch_embedding."),
    (r"visual\.ln_pre\.", "vision_model.pre_layrnorm."),
    (r"visual\.ln_post\.", "vision_model.post_layernorm."),
    (r"visual\.proj$", "visual_projection.weight"),
    (r"visual\.transformer\.resblocks\.", "vision_model.encoder.layers."),
    (r"transformer\.resblocks\.", "text_model.encoder.layers."),
    (r"positional_embedding", "text_model.embeddings.position_embedding.weight"),
    (r"token_embedding\.", "text_model.embeddings.token_embedding."),
    (r"ln_final\.", "text_model.final_layer_norm."),
    (r"text_projection$", "text_projection.weight"),
)
_LAYERS = (
    (r"\.ln_([12])\.", r".layer_norm\1."),
    (r"\.mlp\.c_fc\.", ".mlp.fc1."),
    (r"\.mlp\.c_proj\.", ".mlp.fc2."),
    (r"\.attn\.", ".self_attn."),
)
_TURNED = ("visual.proj", "text_projection")  # are multiplied from the other side
_JOINED = "self_attn.in_proj_"
_HIGHEST = 2  # transformers' sign for a sentence whose end is its highest token


def clip_settings(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the settings of a CLIP from those of open_clip. Raises WeightsError for another kind of network."""
    try:
        model = record["model_cfg"]
        vision, text = model["vision_cfg"], model["text_cfg"]
        foreign = sorted({"timm_model_name", "hf_model_name"} & {*vision, *text})
        if foreign or isinstance(vision["layers"], list):
            kind = (vision | text)[foreign[0]] if foreign else "ResNet"
            raise WeightsError(f"its {OPEN_CLIP} is of a {str(kind)[:40]!r}; of open_clip's only its own ViTs are read")
        act = "quick_gelu" if model.get("quick_gelu") else "gelu"
        towers = [
            {
                "hidden_size": tower["width"], "num_hidden_layers": tower["layers"], "num_attention_heads": heads,
                "intermediate_size": int(tower["width"] * tower.get("mlp_ratio", 4)), "hidden_act": act,
            }
            for tower, heads in ((vision, vision["width"] // vision.get("head_width", 64)), (text, text["heads"]))
        ]  # fmt: skip
        return {
            "model_type": "clip", "projection_dim": model["embed_dim"],
            "vision_config": towers[0] | {"image_size": vision["image_size"], "patch_size": vision["patch_size"]},
            "text_config": towers[1] | {
                "vocab_size": text.get("vocab_size", 49408), "eos_token_id": _HIGHEST,
                "max_position_embeddings": text.get("context_length", 77),
            },
        }  # fmt: skip
    except (KeyError, TypeError, AttributeError, ZeroDivisionError) as cause:
        raise WeightsError(f"{OPEN_CLIP} is not the settings of a network; fetch it again") from cause


def clip_tensors(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Returns tensors of open_clip under the names of `transformers`; unknown ones keep their names."""
    found: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        new = next((after + name[match.end() :] for place, after in _TOWERS if (match := re.match(place, name))), name)
        for place, after in _LAYERS:
            new = re.sub(place, after, new)
        if _JOINED in new:
            stem, _, end = new.partition(_JOINED)
            for part, piece in zip("qkv", tensor.chunk(3), strict=True):
                found[f"{stem}self_attn.{part}_proj.{end}"] = piece.contiguous()
        else:
            found[new] = tensor.T.contiguous() if name in _TURNED else tensor
    return found
