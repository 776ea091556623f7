"""The chain engine: a strip as hinged links in MuJoCo; it plays the plant."""
