"""Commands whose options fill a page of their own; `obsdesign.cli` puts them into the group."""
