"""The store of a team: cells, maps, programs and corrections, who released them, and an audit trail of every change.

The command line and the web application use it if a store is named; nothing below imports it. SQLAlchemy is imported
with `truepose.store.store`, not with this package, so that commands without a store start as fast as before.
"""
