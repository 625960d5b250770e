"""Users' own pictures as a data set to train on (thesis 6.2): approximate cameras, light and exposure not known."""
