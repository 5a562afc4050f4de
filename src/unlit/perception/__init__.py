"""What networks say of the photo: faces, expression, what each pixel shows."""
