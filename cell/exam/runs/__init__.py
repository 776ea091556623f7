"""The runs of a case, made from the model or folded through images."""
