"""Programs of Universal Robots' own editor (.urp): packed XML."""
