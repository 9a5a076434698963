"""cavirheo: material properties of soft matter from the radius history of a laser-made bubble."""
