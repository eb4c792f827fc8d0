from gcs.cli import main

main()
