"""Whether renderers agree: every pair, in every scene, in pictures and derivatives: `docs/consistency.md`."""
