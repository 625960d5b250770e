"""What a run leaves for people to look at: one self-contained HTML page, and one picture. Importing it is free."""
