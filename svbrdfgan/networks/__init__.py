"""The generator and the discriminator of thesis 4.3.1."""
