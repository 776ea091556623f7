"""Tasks of the calibration wizard by ask and tell: each requests images and judges them."""
