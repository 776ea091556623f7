"""The chain engine: a strip as hinged rigid links in MuJoCo; the twin's plant."""
