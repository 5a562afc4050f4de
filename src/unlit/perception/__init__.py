"""What off-the-shelf networks and colour say of the photo: faces, expression, regions."""
