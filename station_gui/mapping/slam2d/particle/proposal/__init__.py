"""Where a particle goes next: matching on its own map and sampling round the match."""
