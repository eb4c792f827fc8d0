from gcs.commands.cli import main

main()
