"""Encoder bias: an encoder reads a constant too much or too little."""

from cell.gap.subject.mechanism.effect import MODES, Effect, per_encoder, put_by_encoder

EFFECT = Effect(
    name="encoder_bias",
    sentence="encoders read a constant too much or too little",
    of="rig",
    source="zero of an encoder",
    parameters=lambda m: per_encoder(m, "bias", "rad", 0.03),
    read=put_by_encoder("bias"),
    modes=MODES,
    revealed_by="hold still in several poses",
)
