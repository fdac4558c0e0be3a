"""What a placement is worth: cost, latencies, loads; plainly and exactly, without the search."""
