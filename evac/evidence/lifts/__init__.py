"""Lifts and escalators: strategies of evacuation in twin towers, and flows of escalators."""
