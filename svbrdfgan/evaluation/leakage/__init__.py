"""The leakage probe: what tells real from fake besides the texture, found before a training run is spent."""
