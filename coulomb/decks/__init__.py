"""Input files of CalculiX and Abaqus (decks): cards, geometry, and what they are as tables of a case file."""
