"""Output: recorders, the trajectory file, results, VTK files and pictures."""

#: What `evac render` draws if nothing else is named.
PICTURE_NAME, FILM_NAME = "picture.png", "film.gif"
