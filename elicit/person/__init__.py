"""A person as the tutor: sessions kept in a log, whole-number questions, and hosts.

``session`` is built on an asker and a log. ``showing`` turns a question into words and counts.
``interview`` takes the messages of every host, such as a browser page, and replies with the next
screen. It has four parts: ``next_question`` chooses questions beside the asker's, ``mending``
settles conflicts and takes answers back, ``drawing`` fills the screens other than a question, and
``beside`` computes in a thread what follows each answer. In a browser the files of ``page`` draw
the screens. ``course`` decides what comes next. ``report`` is the page that the person keeps.
``study`` is several people at once.

This folder imports from every folder of ``elicit``; only ``study`` needs ``diagnostics``. A host's
further dependencies are imported when it is used.
"""
