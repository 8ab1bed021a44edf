"""What stands in streets and is no object: street furniture and plants, their models and their places."""
