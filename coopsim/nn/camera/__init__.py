"""Networks that read pictures: what a picture shows, lifted into space and seen from above."""
