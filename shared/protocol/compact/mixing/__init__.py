"""Binary decisions, coded by mixing what many contexts expect of them."""
