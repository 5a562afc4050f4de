"""The folder of results: written whole or not at all, loaded again to the bit."""
