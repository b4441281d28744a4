"""Control of a robot that moves sideways and turns on the spot: the body is a disc, so only its way matters."""
