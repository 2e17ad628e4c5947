"""The commands, by what they are about; `obsdesign.cli` puts them into one group."""
