"""From a layer to a picture and back: compositing, the render layer, stored light transport, argument validation."""
