"""Policies on floors that none was trained on: experiments and rows -> one table, held against the rule."""
