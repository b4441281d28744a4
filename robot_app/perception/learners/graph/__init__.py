"""What standard GNG and FastGNG share: draws, the nearest two nodes, connections with ages."""
