"""Shows weathered models in a browser: live, while sliders repaint them, or as one page that works offline."""
