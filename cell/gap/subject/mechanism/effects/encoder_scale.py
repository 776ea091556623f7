"""Encoder scale error: an encoder counts too many or too few steps per turn."""

from cell.gap.subject.mechanism.effect import Effect, per_encoder, put_by_encoder

EFFECT = Effect(
    name="encoder_scale",
    sentence="encoders count too much or too little a turn",
    of="rig",
    source="scale of an encoder",
    parameters=lambda m: per_encoder(m, "scale", "1", 0.02),
    read=put_by_encoder("scale"),
    revealed_by="large motion to both stops",
)
